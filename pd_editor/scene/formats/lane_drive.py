"""Motion along lanes as a list of speeds and lane changes tells it, such as OpenSCENARIO's."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector
from pd_editor.scene.geometry.polyline import arc_length, without_repeats
from pd_editor.scene.road_map import Lane
from pd_editor.scene.thresholds import STANDING_MPS

_REACH_M: Final = 3.0
_SAME_WAY: Final = 0.7
"""Cosine of the largest turn between who is on a lane and the lane."""
_AGAINST_M: Final = 2.0
"""Lanes of the other direction count as this much further away."""
_FARTHEST_M: Final = 5000.0
_CHANGE_S: Final = 4.0
"""How long a change of lane takes that a route needs."""
NEAR_M: Final = 5.0
"""Who comes no nearer to a place does not reach it."""
_REACHED_M: Final = 0.1
_CLOSING_S: Final = 1.0
"""Time in which most of what a distance is wrong by is made up."""
Key = tuple[str, int, int, bool]
"""Road, index of the section, id of the lane, whether it is driven as the road goes."""


@dataclass(frozen=True, eq=False)
class Way:
    """A line along lanes; ``lanes`` are their numbers, and whether they are driven against."""

    line: Float[np.ndarray, "N 2"]
    starts_m: Sequence[float] = ()
    lanes: Sequence[tuple[int, bool]] = ()

    def at(
        self, s: Float[np.ndarray, "T"]
    ) -> tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T"]]:
        """Points and headings; those before and after the line are straight on."""
        along = arc_length(self.line)
        row = np.clip(np.searchsorted(along, s, "right") - 1, 0, len(self.line) - 2)
        heading = heading_of(np.diff(self.line, axis=0))[row]
        rest = (s - along[row])[:, None]
        return self.line[row] + rest * unit_vector(heading), heading

    def lane_at(self, s: float) -> tuple[int, bool] | None:
        """The lane at a place, and whether it is driven against; None off lanes."""
        row = max(int(np.searchsorted(self.starts_m, s, "right")) - 1, 0)
        return self.lanes[row] if self.lanes else None

    def place_of(self, point: Float[np.ndarray, "2"]) -> float:
        """Place of the nearest point of the line."""
        return float(shapely.LineString(self.line).project(shapely.Point(point)))


class RoadLanes:
    """Lanes with their ids on roads."""

    def __init__(self, lanes: Sequence[Lane], number: Mapping[Key, int]) -> None:
        self._lane_of = {one.lane_id: one for one in lanes}
        self._key_of = {n: key for key, n in number.items() if n in self._lane_of}
        self._number = {key: n for n, key in self._key_of.items()}
        self._ids = list(self._lane_of)
        self._lines = [shapely.LineString(one.centerline_m) for one in lanes]
        self._tree = shapely.STRtree(self._lines)

    def lane_of(self, x: float, y: float, heading: float) -> tuple[int, bool] | None:
        """The lane that somebody is on, and whether it is driven against."""
        point, found = shapely.Point(x, y), []
        for row in self._tree.query(point, "dwithin", distance=_REACH_M).tolist():
            line = self._lines[row]
            way = Way(np.asarray(line.coords)[:, :2])
            ((_,), (along,)) = way.at(np.array([line.project(point)]))
            fits = 1.0 if np.isnan(heading) else float(np.cos(heading - along))
            if abs(fits) >= _SAME_WAY:
                rank = line.distance(point) + _AGAINST_M * (fits < 0) - abs(fits)
                found.append((rank, self._ids[row], fits < 0))
        return min(found)[1:] if found else None

    def id_of(self, lane: tuple[int, bool]) -> tuple[int, int]:
        """Id of a lane on its road, and 1 or -1: where ids grow to the left of who drives."""
        _, _, lane_id, leads_on = self._key_of[lane[0]]
        return lane_id, 1 if leads_on != lane[1] else -1

    def beside(self, lane: tuple[int, bool], lane_id: int) -> tuple[int, bool] | None:
        """The lane of an id beside another one, for who drives as on that."""
        road, section, _, leads_on = self._key_of[lane[0]]
        onward = leads_on != lane[1]
        for against in (False, True):
            number = self._number.get((road, section, lane_id, onward != against))
            if number is not None:
                return number, against
        return None

    def onto(
        self, lane: tuple[int, bool], goals: Collection[int]
    ) -> tuple[int, bool] | None:
        """The nearest lane of the same direction beside one, or itself, that leads to goals."""
        lane_id, _ = self.id_of(lane)
        road, section, _, leads_on = self._key_of[lane[0]]
        beside = [
            (abs(key[2] - lane_id), number)
            for key, number in self._number.items()
            if key[:2] == (road, section) and key[3] == leads_on
        ]
        found = [(number, lane[1]) for _, number in sorted(beside)]
        return next((one for one in found if self.route(one, goals)), None)

    def way(
        self, lane: tuple[int, bool], length_m: float, goals: Collection[int] = ()
    ) -> Way:
        """Along a lane and those after it: towards goals, else straight on at forks."""
        route = self.route(lane, goals)
        number, against = lane
        parts, starts, lanes, total = [], [], [], 0.0
        while total < min(length_m, _FARTHEST_M):
            line = self._lane_of[number].centerline_m[:: -1 if against else 1]
            parts.append(line)
            starts.append(total)
            lanes.append((number, against))
            total += float(arc_length(line)[-1])
            heading = _last_heading(line)
            further = self._after(number, against)
            if not further:
                break
            number = min(
                further,
                key=lambda n: (n not in route, -self._straight(n, lane[1], heading)),
            )
        return Way(without_repeats(np.concatenate(parts)), starts, lanes)

    def _after(self, number: int, against: bool) -> list[int]:
        one = self._lane_of[number]
        found = one.predecessors if against else one.successors
        return [n for n in found if n in self._lane_of]

    def _straight(self, number: int, against: bool, heading: float) -> float:
        line = self._lane_of[number].centerline_m[:: -1 if against else 1]
        return float(np.cos(_last_heading(line) - heading))

    def route(self, lane: tuple[int, bool], goals: Collection[int]) -> set[int]:
        """Lanes on the shortest way to the nearest lane beside a goal."""
        wanted = {self._key_of[n][:2] for n in goals}
        before: dict[int, int | None] = {lane[0]: None}
        rest = [lane[0]] if wanted else []
        for number in rest:
            if self._key_of[number][:2] in wanted:
                found: set[int] = set()
                at: int | None = number
                while at is not None:
                    found.add(at)
                    at = before[at]
                return found
            for one in self._after(number, lane[1]):
                if one not in before:
                    before[one] = number
                    rest.append(one)
        return set()


@dataclass(frozen=True, eq=False)
class _Shift:
    """From a step on, a move onto a way at a distance to its left."""

    first: int
    seconds: float
    shape: str
    way: Way
    start_m: float
    offset_m: float


class Driver:
    """States of somebody from a time on, which speeds and shifts change in order of time."""

    def __init__(
        self,
        graph: RoadLanes,
        pose: Sequence[float],
        speed: float,
        times: Float[np.ndarray, "T"],
    ) -> None:
        self._graph, self.times_s = graph, times
        self.speed_mps = np.full(len(times), speed)
        self._shifts: list[_Shift] = []
        self.place(0, pose)
        self.moves = False
        """Whether it does anything but stand at its first place."""

    def step(self, time_s: float) -> int:
        """The first step at a time or after it, at most the last one."""
        return min(
            int(np.searchsorted(self.times_s, time_s - 1e-6)), len(self.times_s) - 1
        )

    def place(self, step: int, pose: Sequence[float]) -> None:
        """Put it somewhere, from where it goes along the lane there, else straight on."""
        x, y, heading = pose
        lane = self._graph.lane_of(x, y, heading)
        point, ahead = np.array([x, y]), unit_vector(np.array(np.nan_to_num(heading)))
        way = Way(np.stack([point, point + ahead]))
        if lane is not None:
            way = self._graph.way(lane, _FARTHEST_M)
        self._onto(step, 0.0, "step", way, point)

    def _onto(
        self, step: int, seconds: float, shape: str, way: Way, point: np.ndarray,
        offset_m: float | None = None,
    ) -> float:  # fmt: skip
        self.moves = True
        start = way.place_of(point)
        ((middle,), (heading,)) = way.at(np.array([start]))
        if offset_m is None:
            offset_m = float((point - middle) @ left_of(unit_vector(heading)))
        self._shifts.append(_Shift(step, seconds, shape, way, start, offset_m))
        return float(self.times_s[step]) + seconds

    def lane_at(self, step: int) -> tuple[int, bool] | None:
        """The lane that it is on, or changes to."""
        shift = [one for one in self._shifts if one.first <= step][-1]
        return shift.way.lane_at(float(self._along(shift)[step]))

    def change_speed(
        self, step: int, target: float, seconds: float, shape: str
    ) -> float:
        """Reach a speed after some seconds; when that is."""
        since = self.times_s[step:] - self.times_s[step]
        first = self.speed_mps[step]
        self.moves |= target != first
        self.speed_mps[step:] = first + (target - first) * _share(since, seconds, shape)
        return float(self.times_s[step]) + seconds

    def change_lane(
        self, step: int, lane_id: int, seconds: float, shape: str, offset_m: float
    ) -> float | None:
        """Reach a lane of its road after some seconds; None if that is no lane for vehicles."""
        lane = self.lane_at(step)
        target = None if lane is None else self._graph.beside(lane, lane_id)
        if target is None:
            return None
        way = self._graph.way(target, _FARTHEST_M)
        point = self.states()[0][step]
        return self._onto(step, seconds, shape, way, point, offset_m)

    @property
    def offset_m(self) -> float:
        """Distance to the left of its way that it last got."""
        return self._shifts[-1].offset_m

    def change_offset(self, step: int, offset_m: float, seconds: float) -> float:
        """Reach a distance to the left of the lane's middle after some seconds."""
        last, point = self._shifts[-1], self.states()[0][step]
        return self._onto(step, seconds, "sinusoidal", last.way, point, offset_m)

    def go_to(self, step: int, goals: Collection[int]) -> bool:
        """Turn at forks towards lanes, maybe from a lane beside; False if none leads there."""
        lane = self.lane_at(step)
        target = None if lane is None else self._graph.onto(lane, goals)
        if target is None:
            return False
        way, point = self._graph.way(target, _FARTHEST_M, goals), self.states()[0][step]
        shape = (0.0, "step") if target == lane else (_CHANGE_S, "sinusoidal")
        self._onto(step, *shape, way, point, self.offset_m)
        return True

    def arrive(
        self, step: int, point: np.ndarray, time_s: float, speed_mps: float | None
    ) -> bool:
        """Be at a place of its way at a time, with a speed if one is told; False if it cannot."""
        seconds = time_s - float(self.times_s[step])
        way, first = self._shifts[-1].way, float(self.speed_mps[step])
        rest = way.place_of(point) - float(self._along(self._shifts[-1])[step])
        is_near = shapely.LineString(way.line).distance(shapely.Point(point)) < NEAR_M
        if not (is_near and rest > 0 and seconds > self.times_s[1] - self.times_s[0]):
            return False
        mean = rest / seconds
        half_s = seconds if speed_mps is None else seconds / 2
        # The speed at the end, or in the middle of the way to a speed that is told.
        middle = 2 * mean - (first if speed_mps is None else (first + speed_mps) / 2)
        if middle < 0:
            return False
        self.change_speed(step, middle, half_s, "linear")
        if speed_mps is not None:
            half = self.step(float(self.times_s[step]) + half_s)
            self.change_speed(half, speed_mps, time_s - self.times_s[half], "linear")
        return True

    def keep_distance(
        self,
        step: int,
        places: Float[np.ndarray, "T 2"],
        gap: Callable[[float], float],
        limits: tuple[float, float, float],
        is_lasting: bool,
    ) -> float:
        """Follow places, along its way, at a distance by speed; when it is so.

        ``limits`` are acceleration, deceleration and speed. Unless ``is_lasting``, the speed
        stays as soon as the distance is right.
        """
        self.moves = True
        shift, step_s = self._shifts[-1], float(self.times_s[1] - self.times_s[0])
        line = shapely.LineString(shift.way.line)
        points: Any = shapely.points(np.nan_to_num(places))
        ahead = np.asarray(shapely.line_locate_point(line, points))
        theirs = np.gradient(ahead, self.times_s)
        own, end_s = float(self._along(shift)[step]), np.inf
        faster, slower, most = limits
        for row in range(step, len(self.times_s) - 1):
            speed = float(self.speed_mps[row])
            wrong_m = float(ahead[row]) - own - gap(speed)
            if np.isinf(end_s) and abs(wrong_m) < _REACHED_M:
                end_s = float(self.times_s[row])
                if not is_lasting:
                    self.speed_mps[row:] = theirs[row]
                    break
            wanted = float(theirs[row]) + wrong_m / _CLOSING_S - speed
            wanted = speed + np.clip(wanted, -slower * step_s, faster * step_s)
            self.speed_mps[row + 1 :] = np.clip(wanted, 0.0, most)
            own += (speed + float(self.speed_mps[row + 1])) / 2 * step_s
        return end_s

    def seconds_of(self, step: int, distance_m: float) -> float:
        """How long it takes for a distance."""
        way = self._travelled()
        last = int(np.searchsorted(way, way[step] + distance_m))
        return float(self.times_s[min(last, len(way) - 1)] - self.times_s[step])

    def _travelled(self) -> Float[np.ndarray, "T"]:
        steps = (self.speed_mps[1:] + self.speed_mps[:-1]) / 2 * np.diff(self.times_s)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def _along(self, shift: _Shift) -> Float[np.ndarray, "T"]:
        way = self._travelled()
        return shift.start_m + way - way[shift.first]

    def states(
        self,
    ) -> tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T"], Bool[np.ndarray, "T"]]:
        """Places, headings (NaN: of the motion), and whether it is on the map."""
        place = np.zeros((len(self.times_s), 2))
        heading = np.zeros(len(self.times_s))
        there = np.ones(len(self.times_s), bool)
        for one in self._shifts:
            s = self._along(one)
            middle, along = one.way.at(s)
            aside = middle + one.offset_m * left_of(unit_vector(along))
            since = self.times_s - self.times_s[one.first]
            share = _share(since, one.seconds, one.shape)
            share[: one.first] = 0.0
            place += share[:, None] * (aside - place)
            heading[one.first :] = along[one.first :]
            is_within = not one.way.lanes or s <= arc_length(one.way.line)[-1] + 0.01
            there[one.first :] = np.broadcast_to(is_within, there.shape)[one.first :]
        heading[self.speed_mps > STANDING_MPS] = np.nan
        return place, heading, there


def _last_heading(line: Float[np.ndarray, "N 2"]) -> float:
    return float(heading_of(np.diff(line[-2:], axis=0))[0])


def _share(since_s: Float[np.ndarray, "T"], seconds: float, shape: str) -> np.ndarray:
    """Share of a change that is done some time after its begin."""
    if seconds <= 0 or shape == "step":
        return np.ones(len(since_s))
    share = np.clip(since_s / seconds, 0.0, 1.0)
    return share if shape == "linear" else share * share * (3.0 - 2.0 * share)
