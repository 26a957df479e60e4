"""Phases of junctions: which movements may go at a moment, as signals would tell."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.road_map import LaneKind, RoadMap, once_per_map
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal, SignalState, signals_of_lanes

_NEAR_M: Final = 2.0
"""Lanes through one junction come this near to each other."""
_LEAST_CONFLICTS: Final = 2
_SIDE_RAD: Final = np.radians(45)
"""Ways into a junction that differ by more, modulo a half turn, have green in turn."""
_TURN_RAD: Final = np.radians(40)
_LEFT_TURN_SHARE: Final = 0.15
"""Share of the phases that are of left turns alone."""
_GREEN_S: Final = (12.0, 35.0)
_CAUTION_S: Final = 3.0
_CHANGE_S: Final = 4.0
"""Time from the end of green to the next phase, caution included."""
_KEY: Final = 0x50484153


@dataclass(frozen=True, kw_only=True, eq=False)
class Junction:
    """Lanes by which M movements enter a junction whose movements conflict."""

    lane_ids: Int[np.ndarray, "M"]
    heading_rad: Float[np.ndarray, "M"]
    """Direction in which each movement enters."""
    turn_rad: Float[np.ndarray, "M"]
    """Turn to the left until its end."""
    conflicts: Bool[np.ndarray, "M M"]
    """Whether two movements from different ways in cross or merge."""

    def sampled_phase(self, random: np.random.Generator) -> Bool[np.ndarray, "M"]:
        """Movements that go in a plausible phase, the more likely the more lanes it has."""
        return self.phase_of(
            int(random.integers(len(self.lane_ids))),
            turns_left=random.random() < _LEFT_TURN_SHARE,
        )

    def phase_of(self, movement: int, *, turns_left: bool) -> Bool[np.ndarray, "M"]:
        """Movements that go together with one of them.

        These are of one street, from both its ends; either those that turn left, or all
        others and the left turns without oncoming traffic.
        """
        gap = wrap_angle(2 * (self.heading_rad - self.heading_rad[movement])) / 2
        goes = np.abs(gap) < _SIDE_RAD
        left = goes & (self.turn_rad > _TURN_RAD)
        first, later = (left, goes & ~left) if turns_left else (goes & ~left, left)
        if not first.any():
            return goes
        return first | (later & ~(self.conflicts & first).any(axis=1))

    def phases_after(self, first: Bool[np.ndarray, "M"]) -> Bool[np.ndarray, "N M"]:
        """Phases in turn, the first one given, by which each movement goes once at least."""
        phases = [first]
        while not (gone := np.any(phases, axis=0)).all():
            waits = int(np.argmin(gone))
            turns_left = bool(self.turn_rad[waits] > _TURN_RAD)
            phases.append(self.phase_of(waits, turns_left=turns_left))
        return np.array(phases)

    def programme(
        self,
        first: Bool[np.ndarray, "M"],
        num_steps: int,
        step_s: float,
        random: np.random.Generator,
        begun_s: float | None = None,
        over_s: float | None = None,
    ) -> Int[np.ndarray, "M S"]:
        """States over some steps, from a moment on in a phase or shortly after it.

        For how long it has lasted, or is over, may be known; else it lasts beyond the
        first step. Each ends with caution of those that wait in the next one, and a clear
        junction.
        """
        phases = self.phases_after(first)
        states = np.full((len(first), num_steps), SignalState.STOP, np.int8)
        green_s = random.uniform(*_GREEN_S, len(phases))
        at_s, number = (2 * step_s - green_s[0]) * random.random(), 0
        if over_s is not None:
            at_s = -over_s - green_s[0]
        elif begun_s is not None:
            at_s = -min(begun_s, green_s[0] - 2 * step_s)
        while at_s < num_steps * step_s:
            now, later = phases[number], phases[(number + 1) % len(phases)]
            ends_s = at_s + green_s[number]
            times_s = (at_s, ends_s, ends_s + _CAUTION_S, ends_s + _CHANGE_S)
            begin, end, clear, after = (max(int(one / step_s), 0) for one in times_s)
            states[now, begin:end] = SignalState.GO
            states[now & ~later, end:clear] = SignalState.CAUTION
            states[now & later, end:after] = SignalState.GO
            at_s, number = ends_s + _CHANGE_S, (number + 1) % len(phases)
        return states

    def controlled(
        self, lane_ids: Collection[int], road_map: RoadMap
    ) -> dict[int, Int[np.ndarray, "C"]]:
        """Movements that some lanes are or lead to, by the lane; straight ones first."""
        found = {}
        for lane_id in lane_ids:
            lane = road_map.lane_of.get(lane_id)
            after = () if lane is None or lane.is_intersection else lane.successors
            rows = np.flatnonzero(np.isin(self.lane_ids, [lane_id, *after]))
            if len(rows):
                found[lane_id] = rows[np.argsort(np.abs(self.turn_rad[rows]))]
        return found


def _signals(
    states: Mapping[int, Int[np.ndarray, "T"]], name: str, share: Mapping[int, float]
) -> list[Signal]:
    """Signals of lanes by their states; those with equal ones have one."""
    lane_ids, rows = np.array(list(states)), np.array(list(states.values()))
    kinds = np.unique(rows, axis=0)
    chosen = [lane_ids[(rows == own).all(axis=1)].tolist() for own in kinds]
    return [
        Signal(
            signal_id=f"{name}:{row}",
            lane_ids=tuple(lanes),
            stop_share=np.array([share.get(lane, 0.0) for lane in lanes]),
            states=own.copy(),
        )
        for row, (own, lanes) in enumerate(zip(kinds, chosen, strict=True))
    ]


@once_per_map
def junctions(road_map: RoadMap) -> tuple[Junction, ...]:
    """Junctions with movements that cross, of lanes for vehicles."""
    lanes = [
        lane
        for lane in road_map.lanes
        if lane.is_intersection
        and lane.kind is not LaneKind.BIKE
        and len(lane.centerline_m) > 1
    ]
    if not lanes:
        return ()
    inside = {lane.lane_id for lane in lanes}
    lines = np.array([shapely.LineString(lane.centerline_m) for lane in lanes])
    group = _connected(lines)
    found = []
    for number in range(group.max() + 1):
        rows = [
            row
            for row in np.flatnonzero(group == number).tolist()
            if not inside & set(lanes[row].predecessors)
        ]
        ways = [_way(lanes[row].lane_id, road_map, inside) for row in rows]
        if len(ways) < 2:
            continue
        start = np.array([way[0] for way in ways])
        heading = heading_of(np.array([way[1] - way[0] for way in ways]))
        end = heading_of(np.array([way[-1] - way[-2] for way in ways]))
        line = np.array([shapely.LineString(way) for way in ways])
        conflicts = shapely.intersects(line[:, None], line)
        conflicts &= np.linalg.norm(start[:, None] - start, axis=-1) > _NEAR_M
        junction = Junction(
            lane_ids=np.array([lanes[row].lane_id for row in rows]),
            heading_rad=heading,
            turn_rad=wrap_angle(end - heading),
            conflicts=conflicts,
        )
        gap = np.abs(wrap_angle(2 * (heading[:, None] - heading))) / 2
        if (conflicts & (gap > _SIDE_RAD)).sum() / 2 >= _LEAST_CONFLICTS:
            found.append(junction)
    return tuple(found)


def sampled_signals(scenario: Scenario, seed: int) -> tuple[Signal, ...]:
    """Signals of all junctions, each in a plausible phase that lasts."""
    random = np.random.default_rng([seed, _KEY])
    return tuple(
        signal
        for number, one in enumerate(junctions(scenario.original_road_map))
        for signal in _lasting(one, one.sampled_phase(random), scenario, number)
    )


def continued_signals(
    scenario: Scenario, num_steps: int, seed: int
) -> tuple[Signal, ...]:
    """Signals over another number of steps.

    Those of a junction go on with its phases in turn: after the last step that is known,
    or from the current one if its phase lasts for the whole scene. Signals of other lanes,
    and unknown ones, keep their last state.
    """
    random = np.random.default_rng([seed, _KEY, 1])
    road_map = scenario.original_road_map
    known = {n: one.states for one in scenario.signals for n in one.lane_ids}
    share = {
        lane: float(place)
        for one in scenario.signals
        for lane, place in zip(one.lane_ids, one.stop_share, strict=True)
    }
    found: list[Signal] = []
    for number, one in enumerate(junctions(road_map)):
        told = [n for n, states in known.items() if states[-1] != SignalState.UNKNOWN]
        rows = one.controlled(told, road_map)
        if rows:
            own = {n: known.pop(n) for n in sorted(rows, key=lambda n: rows[n][0])}
            later = _continued(one, own, rows, scenario, num_steps, random)
            found += _signals(later, f"junction {number}", share)
    kept = signals_of_lanes(scenario.signals, known)
    return (
        *(
            replace(one, states=np.pad(one.states, (0, num_steps), "edge")[:num_steps])
            for one in kept
        ),
        *found,
    )


def _continued(
    junction: Junction,
    known: Mapping[int, Int[np.ndarray, "T"]],
    rows: Mapping[int, Int[np.ndarray, "C"]],
    scenario: Scenario,
    num_steps: int,
    random: np.random.Generator,
) -> dict[int, Int[np.ndarray, "S"]]:
    """States of lanes over another number of steps, by the movements that they control."""
    step_s = scenario.time_axis.step_s
    states = np.array(list(known.values()))
    goes = states == SignalState.GO
    lasts = not np.ptp(states, axis=1).any()
    last = scenario.current_step if lasts else states.shape[1] - 1
    end = int(np.flatnonzero(goes.any(axis=0))[-1]) if goes.any() else last
    others = np.flatnonzero((goes[:, : end + 1] != goes[:, [end]]).any(axis=0))
    begin = int(others[-1]) + 1 if len(others) else 0
    first = np.zeros(len(junction.lane_ids), bool)
    for one, own in zip(known, goes[:, end], strict=True):
        first[rows[one]] |= own
    since: dict[str, float] = {}
    if not lasts and goes[:, last].any():
        since = {"begun_s": (last - begin) * step_s}
    elif not lasts:
        since = {"over_s": (last - end - 1) * step_s}
    count = max(num_steps - last, 1)
    later = junction.programme(first, count, step_s, random, **since)
    return {
        one: np.concatenate([own[: last + 1], later[rows[one][0], 1:]])[:num_steps]
        for one, own in known.items()
    }


def _lasting(
    junction: Junction,
    goes: Bool[np.ndarray, "M"],
    scenario: Scenario,
    number: int,
) -> list[Signal]:
    """Signals of a junction whose phase lasts for the whole scene."""
    states = np.where(goes, SignalState.GO, SignalState.STOP).astype(np.int8)
    steps = np.repeat(states[:, None], scenario.time_axis.num_steps, axis=1)
    of_lanes = dict(zip(junction.lane_ids.tolist(), steps, strict=True))
    return _signals(of_lanes, f"junction {number}", {})


def signals_with_green(scenario: Scenario, lane_id: int) -> tuple[Signal, ...] | None:
    """Signals after a lane was given green, all others of its junction by its phase.

    None if the lane does not lead into a junction with crossing traffic, or through one.
    """
    road_map = scenario.original_road_map
    for number, one in enumerate(junctions(road_map)):
        rows = one.controlled([lane_id], road_map)
        if rows:
            straight = rows[lane_id][0]
            turns_left = one.turn_rad[straight] > _TURN_RAD
            goes = one.phase_of(int(straight), turns_left=bool(turns_left))
            kept = signals_of_lanes(
                scenario.signals, set(road_map.lane_of) - set(one.lane_ids.tolist())
            )
            return (*kept, *_lasting(one, goes, scenario, number))
    return None


def _connected(lines: np.ndarray) -> Int[np.ndarray, "L"]:
    """Number of the group of each line; lines of a group come near to each other."""
    tree = shapely.STRtree(lines)
    one, other = tree.query(lines, predicate="dwithin", distance=_NEAR_M)
    group = np.arange(len(lines))
    while True:
        least = group.copy()
        np.minimum.at(least, one, group[other])
        if np.array_equal(least, group):
            return np.unique(group, return_inverse=True)[1]
        group = least


def _way(lane_id: int, road_map: RoadMap, inside: set[int]) -> Float[np.ndarray, "N 2"]:
    """Centre line of a movement, over all its lanes through the junction."""
    parts, seen = [], set()
    while lane_id in inside and lane_id not in seen:
        seen.add(lane_id)
        lane = road_map.lane_of[lane_id]
        parts.append(lane.centerline_m)
        lane_id = next(iter(lane.successors), -1)
    return np.concatenate(parts)
