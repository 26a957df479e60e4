"""Writes scenes as SUMO networks with floating-car data and routes."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from itertools import groupby
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.base.plain_text import csv_file
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.formats.scene_format import IDS_NAME, WrittenScene, losses_of
from pd_editor.scene.formats.sumo_net import ALLOWED_ON, CROSSWALK, JUNCTION, PAVED
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.polyline import arc_length, resample
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import (
    MAX_TURN_RAD,
    ON_LANE_M,
    lane_kinds_of,
)
from pd_editor.scene.road_map import Lane, RoadMap
from pd_editor.scene.scenario import Scenario

_TURNS_RAD: Final = np.deg2rad(30.0)
_TURNS_BACK_RAD: Final = np.deg2rad(150.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """Way through a junction from one lane to another."""

    lanes: tuple[int, ...]
    """The two, and if they do not meet the lane between them."""
    line_m: Float[np.ndarray, "N 2"]
    """Of the lane through the junction, else of the one before."""
    num_lanes: int
    """Of the road that it comes from."""

    @property
    def inside(self) -> tuple[int, ...]:
        """The lane within the junction, if there is one."""
        return self.lanes[1:-1]

    @cached_property
    def headings_rad(self) -> Float[np.ndarray, "2"]:
        """Heading of the line's first and last piece."""
        return heading_of(np.diff(self.line_m, axis=0)[[0, -1]])

    @cached_property
    def turn_rad(self) -> float:
        """By how much the line turns in all, to the left."""
        return float(wrap_angle(np.diff(self.headings_rad))[0])

    @cached_property
    def direction(self) -> str:
        """SUMO's letter: straight, right, left or turning back."""
        if abs(self.turn_rad) < _TURNS_RAD:
            return "s"
        if abs(self.turn_rad) > _TURNS_BACK_RAD:
            return "t"
        return "l" if self.turn_rad > 0 else "r"

    def waits_for(self, other: "Way") -> bool:
        """Whether it waits where the two meet.

        Straight on goes before turns to the right, these before turns to the left. Of
        ways that turn alike and merge the straighter one goes first; of those that cross
        the one of the road with more lanes, else the one from the right.
        """
        if self.takes_turns_with(other):
            return True
        rank, its = ("srlt".index(one.direction) for one in (self, other))
        if rank != its:
            return rank > its
        if self.lanes[-1] == other.lanes[-1]:
            mine, its_own = ((abs(one.turn_rad), one.lanes) for one in (self, other))
            return mine > its_own
        if self.num_lanes != other.num_lanes:
            return self.num_lanes < other.num_lanes
        side = np.sin(other.headings_rad[0] - self.headings_rad[0])
        return bool(side > 0 or (side == 0 and self.lanes > other.lanes))

    def takes_turns_with(self, other: "Way") -> bool:
        """Whether both merge without lanes of the junction, so that no road is first."""
        return not self.inside and not other.inside

    def is_equal_to(self, other: "Way") -> bool:
        """Whether the one from the right goes first."""
        return (
            self.direction == other.direction
            and self.lanes[-1] != other.lanes[-1]
            and self.num_lanes == other.num_lanes
        )


def meetings(ways: Sequence[Way]) -> Bool[np.ndarray, "W W"]:
    """Which ways meet: they end in the same lane, or both lead through and cross.

    Ways from the same lane follow each other, and do not meet.
    """
    start, end = (np.array([one.lanes[k] for one in ways]) for k in (0, -1))
    lines = np.array([shapely.LineString(one.line_m) for one in ways], object)
    found = end[:, None] == end
    inside = np.flatnonzero([bool(one.inside) for one in ways])
    one, other = shapely.STRtree(lines[inside]).query(lines[inside], "intersects")
    found[inside[one], inside[other]] = True
    return found & (start[:, None] != start)


_CLASSES: Final = {
    AgentKind.VEHICLE: "passenger",
    AgentKind.BUS: "bus",
    AgentKind.MOTORCYCLIST: "motorcycle",
    AgentKind.CYCLIST: "bicycle",
    AgentKind.PEDESTRIAN: "pedestrian",
}
"""Vehicle classes; other kinds are of a class of their own."""
_LEAST_SPEED_MPS: Final = 13.9
"""Limit of all lanes, unless somebody drives faster."""
_MAX_UNSEEN: Final = 2
"""Edges of a route on which the recorded vehicle was never nearest, at most."""
_REFUSED: Final = re.compile(r"[^A-Za-z0-9_.-]")
_LOSSES: Final = (
    "Boundaries of lanes: SUMO has one width a lane.",
    "Right of way of signs: straight on goes before turns, wider roads before narrower "
    "ones, right before left. Lanes through a junction that fork, merge or end in it "
    "have none.",
    "Speed limits: all lanes have the same, since scenes have none.",
    "Motion of routes: they begin as recorded, and SUMO drives them its own way; the "
    "floating-car data have the recorded motion.",
)
_KEEPS: Final = frozenset(
    {"signals", "shared signals", "links", "neighbors", "lane kinds", "junctions"}
    | {"crosswalks", "paved", "static kinds"}
)


def write(scenario: Scenario) -> WrittenScene:
    """Files of a network with every lane as it is, of the motion, and of routes.

    A lane is a lane of an edge that it shares with its neighbours, an internal one
    where it leads through a junction, so that geometry and links are exact. Coordinates
    are those of the city, times those since the first step.
    """
    name, axis = scenario.scenario_id, scenario.time_axis
    network = _Network(scenario)
    types = _types(scenario)
    routes, left_out = _routes(scenario, network, types)
    losses: list[str] = list(_LOSSES)
    if left_out:
        losses.append(f"Routes of {left_out} vehicles that do not follow lanes.")
    if apart := network.num_apart:
        losses.append(f"{apart} neighbours of lanes, which are no part of one edge.")
    if scenario.signals:
        lights = {light for light, _ in network.light_of.values()}
        nowhere = len(scenario.signals) - len(lights)
        losses.append("Places of stop lines within lanes.")
        if nowhere:
            losses.append(f"{nowhere} signals of lanes that lead nowhere.")
    config = [
        f'<input><net-file value="{name}.net.xml"/><route-files value="{name}.rou.xml"/>'
        f'<additional-files value="{name}.add.xml"/></input>',
        f'<time><begin value="0"/><end value="{axis.num_steps * axis.step_s:g}"/>'
        f'<step-length value="{axis.step_s:g}"/></time>',
    ]
    table = [(f"lane {number}", other) for number, other in network.name_of.items()]
    table += [(f"agent {one}", _as_id(one)) for one in scenario.agents.ids]
    table += [
        (f"signal {s.signal_id}", f"tl{n}") for n, s in enumerate(scenario.signals)
    ]
    parts = {
        "net.xml": ('net version="1.20" limitTurnSpeed="-1"', network.lines()),
        "add.xml": ("additional", _areas(scenario)),
        "fcd.xml": ("fcd-export", _motion(scenario, types)),
        "rou.xml": ("routes", routes),
        "sumocfg": ("configuration", config),
    }
    files = {
        f"{name}.{ending}": "\n".join(
            ['<?xml version="1.0" encoding="UTF-8"?>', f"<{tag}>", *lines,
             f"</{tag.partition(' ')[0]}>\n"]
        )
        for ending, (tag, lines) in parts.items()
    }  # fmt: skip
    encoded = {name: text.encode() for name, text in files.items()}
    encoded[IDS_NAME] = csv_file([("ours", "sumo"), *table])
    told = losses_of(scenario, *losses, keeps=_KEEPS)
    renamed = {one: _as_id(one) for one in scenario.agents.ids}
    return WrittenScene(files=encoded, losses=told, renamed=renamed)


class _Network:
    """Edges of neighbouring lanes, and junctions between them.

    Lanes through a junction are internal ones, if one lane leads to them and one from
    them: SUMO knows who gives way on these.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._road_map, self._origin = scenario.road_map, scenario.origin_city_m
        known = self._road_map.lane_of
        self.after = {
            n: [known[m] for m in dict.fromkeys(lane.successors) if m in known]
            for n, lane in known.items()
        }
        self._signals, self._step_s = scenario.signals, scenario.time_axis.step_s
        self.light_of = self._light_of()
        """Signal and index of the links that obey one, by their lanes."""
        self._beside = self._lanes_beside(scenario.road_map)
        self.groups: list[list[Lane]] = []
        self.place_of: dict[int, tuple[int, int]] = {}
        for inside in (False, True):
            for ids in scenario.road_map.lane_groups:
                for beside, run in groupby(ids, self._edges_beside):
                    if (beside is not None) == inside:
                        group = [known[n] for n in run]
                        for index, lane in enumerate(group):
                            self.place_of[lane.lane_id] = len(self.groups), index
                        self.groups.append(group)
        speed = np.hypot(*scenario.agents.velocity_mps.reshape(-1, 2).T)
        self.speed_mps = float(max(_LEAST_SPEED_MPS, speed.max(initial=0.0) + 0.1))
        self._ways = list(self._ways_through())
        self._meet = meetings(self._ways)
        self._waits = np.zeros_like(self._meet)
        for row, other in np.argwhere(self._meet):
            self._waits[row, other] = self._ways[row].waits_for(self._ways[other])
        self._parent = list(range(2 * len(self.groups)))
        self._join()
        self.name_of = {
            n: f"{self.edge_name(one)}_{two}" for n, (one, two) in self.place_of.items()
        }

    @property
    def num_apart(self) -> int:
        """Number of neighbours that lead the same way on another edge."""
        road_map, place_of = self._road_map, self.place_of
        return sum(
            place_of[other][0] != place_of[one.lane_id][0]
            for one in road_map.lanes
            for other in (one.left_neighbor, one.right_neighbor)
            if other in place_of and (one.lane_id, other) not in road_map.oncoming
        )

    def _lanes_beside(self, road_map: RoadMap) -> dict[int, tuple[int, int]]:
        """Lanes before and after those that are to be internal."""
        before: defaultdict[int, list[int]] = defaultdict(list)
        for number, following in self.after.items():
            for one in following:
                before[one.lane_id].append(number)
        found: dict[int, tuple[int, int]] = {}
        for number, lane in road_map.lane_of.items():
            beside = {*before[number], *(one.lane_id for one in self.after[number])}
            if (
                lane.is_intersection
                and len(before[number]) == len(self.after[number]) == 1
                and len(beside - found.keys() - {number}) == 2
                and (number, self.after[number][0].lane_id) not in self.light_of
            ):
                found[number] = before[number][0], self.after[number][0].lane_id
        return found

    def _edges_beside(self, number: int) -> tuple[int | None, ...] | None:
        """Edges between which an internal lane is; None for others."""
        beside = self._beside.get(number)
        known = self.place_of
        return beside and tuple(known[n][0] if n in known else None for n in beside)

    def _ways_through(self) -> Iterator[Way]:
        """Ways from lanes to the next ones, in the order of edges."""
        for lane, num in ((one, len(group)) for group in self.groups for one in group):
            following = self.after[lane.lane_id] if not self.is_inside(lane) else []
            for one in following:
                beyond = self._beside.get(one.lane_id, ())[1:]
                yield Way(
                    lanes=(lane.lane_id, one.lane_id, *beyond),
                    line_m=(one if beyond else lane).centerline_m,
                    num_lanes=num,
                )

    def is_inside(self, lane: Lane) -> bool:
        """Whether it is an internal lane of a junction."""
        return lane.lane_id in self._beside

    def edge_name(self, edge: int) -> str:
        """SUMO's id of an edge."""
        if self.is_inside(self.groups[edge][0]):
            return f":j{self._junction(2 * edge)}_{edge}"
        return f"e{edge}"

    def _join(self) -> None:
        """Make one junction of the ends of lanes that meet, and of ways that do."""
        ends = [2 * self.place_of[one.lanes[0]][0] + 1 for one in self._ways]
        for one, end in zip(self._ways, ends, strict=True):
            for lane in one.lanes[1:]:
                start = self._junction(2 * self.place_of[lane][0])
                self._parent[self._junction(end)] = start
        for row, other in np.argwhere(self._meet).tolist():
            self._parent[self._junction(ends[row])] = self._junction(ends[other])

    def _junction(self, end: int) -> int:
        """Junction of an edge's start (even numbers) or end (odd ones)."""
        while self._parent[end] != end:
            self._parent[end] = self._parent[self._parent[end]]
            end = self._parent[end]
        return end

    def _light_of(self) -> dict[tuple[int, ...], tuple[int, int]]:
        links = [(n, one.lane_id) for n, after in self.after.items() for one in after]
        found: dict[tuple[int, ...], tuple[int, int]] = {}
        for number, signal in enumerate(self._signals):
            sides = (signal.stop_share >= 0.5).tolist()
            # A lane's end is the start of those that follow it.
            stops = {*zip(signal.lane_ids, sides, strict=True)}
            mine = [
                (a, b) for a, b in links if (a, True) in stops or (b, False) in stops
            ]
            free = [link for link in mine if link not in found]
            found |= {link: (number, index) for index, link in enumerate(free)}
        return found

    def _lights(self) -> Iterator[str]:
        """Programmes of the signals that have links: their states, again and again."""
        waits_of: defaultdict[int, list[bool]] = defaultdict(list)
        waiting = {
            one.lanes[:2]
            for row, one in enumerate(self._ways)
            if one.inside and self._waits[row].any()
        }
        for link, (number, _) in self.light_of.items():
            waits_of[number].append(link in waiting)
        for number, waits in waits_of.items():
            yield f'<tlLogic id="tl{number}" type="static" programID="0" offset="0">'
            for state, duration in self._signals[number].phases(self._step_s):
                letter = WORDS[state][2]
                letters = (letter.replace("G", "g") if n else letter for n in waits)
                yield f'<phase duration="{duration:.2f}" state="{"".join(letters)}"/>'
            yield "</tlLogic>"

    def length_m(self, edge: int) -> float:
        """Length of an edge, which all its lanes have for SUMO."""
        lengths = [arc_length(lane.centerline_m)[-1] for lane in self.groups[edge]]
        return max(float(np.mean(lengths)), 0.2)

    def edges_after(self, vehicle_class: str) -> dict[int, set[int]]:
        """Edges that a class of vehicles reaches from each edge."""
        found: defaultdict[int, set[int]] = defaultdict(set)
        for edge, group in enumerate(self.groups):
            for lane in group:
                found[edge] |= self.edges_after_lane(lane, vehicle_class)
        return found

    def edges_after_lane(self, lane: Lane, vehicle_class: str) -> set[int]:
        """Edges that a class of vehicles reaches from a lane."""
        return {
            self.place_of[one.lane_id][0]
            for one in self.after[lane.lane_id]
            if all(vehicle_class in ALLOWED_ON[n.kind].split() for n in (lane, one))
        }

    def lines(self) -> Iterator[str]:
        """The content of the network's file."""
        points = [lane.centerline_m for group in self.groups for lane in group]
        low, high = (f(np.concatenate(points), axis=0) for f in (np.min, np.max))
        corners = np.concatenate([low, high]) + np.tile(self._origin, 2)
        boundary = ",".join(f"{one:.2f}" for one in corners)
        yield (
            f'<location netOffset="0.00,0.00" convBoundary="{boundary}" '
            f'origBoundary="{boundary}" projParameter="!"/>'
        )
        for edge, group in enumerate(self.groups):
            yield from self._edge(edge, group)
        yield from self._lights()
        ends: defaultdict[int, list[int]] = defaultdict(list)
        for edge, group in enumerate(self.groups):
            for end in () if self.is_inside(group[0]) else (2 * edge, 2 * edge + 1):
                ends[self._junction(end)].append(end)
        rows: defaultdict[int, list[int]] = defaultdict(list)
        for row, one in enumerate(self._ways):
            rows[self._junction(2 * self.place_of[one.lanes[0]][0] + 1)].append(row)
        for junction, here in ends.items():
            yield from self._junction_lines(junction, here, rows[junction])
        for row in range(len(self._ways)):
            yield from self._connections(row)

    def _connections(self, row: int) -> Iterator[str]:
        way = self._ways[row]
        light = self.light_of.get(way.lanes[:2])
        told = f'state="{self._state(row)}"'
        if light is not None:
            told = f'tl="tl{light[0]}" linkIndex="{light[1]}" state="o"'
        for number in way.inside:
            told += f' via="{self.name_of[number]}"'
        end, its_lane = self.place_of[way.lanes[-1]]
        for number in way.lanes[:-1]:
            edge, lane = self.place_of[number]
            yield (
                f'<connection from="{self.edge_name(edge)}" to="e{end}" '
                f'fromLane="{lane}" toLane="{its_lane}" dir="{way.direction}" {told}/>'
            )
            told = 'state="M"'

    def _state(self, row: int) -> str:
        """SUMO's letter: major, minor, equal (not all wait for ever), or in turn."""
        way = self._ways[row]
        waits_for = [self._ways[n] for n in np.flatnonzero(self._waits[row])]
        if any(way.takes_turns_with(other) for other in waits_for):
            return "Z"
        if any(way.is_equal_to(other) for other in waits_for):
            return "="
        return "m" if waits_for else "M"

    def _edge(self, edge: int, group: list[Lane]) -> Iterator[str]:
        start, end = self._junction(2 * edge), self._junction(2 * edge + 1)
        kind = JUNCTION if any(one.is_intersection for one in group) else "road"
        told = f'from="j{start}" to="j{end}" priority="1"'
        if self.is_inside(group[0]):
            told = 'function="internal"'
        name = self.edge_name(edge)
        yield f'<edge id="{name}" {told} type="{kind}">'
        for index, lane in enumerate(group):
            across = resample(lane.left_m, 9) - resample(lane.right_m, 9)
            yield (
                f'<lane id="{name}_{index}" index="{index}" '
                f'allow="{ALLOWED_ON[lane.kind]}" speed="{self.speed_mps:.2f}" '
                f'length="{self.length_m(edge):.4f}" '
                f'width="{np.median(np.hypot(*across.T)):.3f}" '
                f'shape="{_shape(lane.centerline_m + self._origin)}"/>'
            )
        yield "</edge>"

    def _junction_lines(
        self, junction: int, ends: list[int], rows: list[int]
    ) -> Iterator[str]:
        touching = [(lane, end % 2) for end in ends for lane in self.groups[end // 2]]
        points = [lane.centerline_m[-1 if last else 0] for lane, last in touching]
        place = np.mean(points, axis=0) + self._origin
        arriving = [self.name_of[lane.lane_id] for lane, arrives in touching if arrives]
        ways = [self._ways[row] for row in rows]
        # SUMO takes the n-th internal lane as that of the n-th way, which one without a
        # lane has not: it is nobody's foe then, though others wait for it.
        known = [n for one in ways for n in one.inside]
        inside = [self.name_of[(*one.inside, *known)[0]] for one in ways if known]
        obeys = any(one.lanes[:2] in self.light_of for one in ways)
        kind = "traffic_light" if obeys else "priority" if rows else "dead_end"
        yield (
            f'<junction id="j{junction}" type="{kind}" '
            f'x="{place[0]:.4f}" y="{place[1]:.4f}" incLanes="{" ".join(arriving)}" '
            f'intLanes="{" ".join(inside)}" shape="{_shape(place[None])}">'
        )
        is_foe = [bool(one.inside) or not known for one in ways]
        for index, row in enumerate(rows):
            waits, foes = self._waits[row, rows], self._meet[row, rows] & is_foe
            yield (
                f'<request index="{index}" response="{_bits(waits)}" '
                f'foes="{_bits(foes)}" cont="0"/>'
            )
        yield "</junction>"


def _bits(flags: Bool[np.ndarray, "W"]) -> str:
    """Flags as SUMO has them: the last one first."""
    return "".join("1" if one else "0" for one in flags)[::-1]


def _shape(points_m: Float[np.ndarray, "N 2"]) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points_m)


def _as_id(name: str) -> str:
    """An agent's id without characters that SUMO refuses."""
    return _REFUSED.sub(lambda found: f"_{ord(found[0]):x}_", name)


def _types(scenario: Scenario) -> list[tuple[str, str]]:
    """Id of each agent's type, which agents of one kind and size share, and its line."""
    agents = scenario.agents
    found: dict[tuple[AgentKind, str], str] = {}
    result = []
    for kind, (length, width) in zip(agents.kinds, agents.size_m, strict=True):
        size = f'length="{length:.4f}" width="{width:.4f}"'
        name = found.setdefault((kind, size), f"{kind.value}_{len(found)}")
        line = f'<vType id="{name}" vClass="{_CLASSES.get(kind, "custom1")}" {size}/>'
        result.append((name, line))
    return result


def _motion(scenario: Scenario, types: list[tuple[str, str]]) -> Iterator[str]:
    """Floating-car data: fronts of vehicles, middles of pedestrians."""
    agents, axis = scenario.agents, scenario.time_axis
    ahead = unit_vector(agents.heading_rad)
    tags = [
        "person" if kind is AgentKind.PEDESTRIAN else "vehicle" for kind in agents.kinds
    ]
    front = np.where([tag == "person" for tag in tags], 0.0, agents.size_m[:, 0] / 2)
    place = agents.position_m + scenario.origin_city_m + front[:, None, None] * ahead
    angle = np.rad2deg(np.pi / 2 - agents.heading_rad) % 360.0
    speed = (agents.velocity_mps * ahead).sum(axis=-1)
    aside = (agents.velocity_mps * left_of(ahead)).sum(axis=-1)
    for step in range(agents.num_steps):
        yield f'<timestep time="{step * axis.step_s:g}">'
        for row in np.flatnonzero(agents.is_valid[:, step]).tolist():
            x, y = place[row, step]
            yield (
                f'<{tags[row]} id="{_as_id(agents.ids[row])}" x="{x:.4f}" y="{y:.4f}" '
                f'angle="{angle[row, step]:.5f}" type="{types[row][0]}" '
                f'speed="{speed[row, step]:.4f}" speedLat="{aside[row, step]:.4f}"/>'
            )
        yield "</timestep>"


def _areas(scenario: Scenario) -> Iterator[str]:
    """Crosswalks and drivable areas as polygons."""
    road_map, origin = scenario.road_map, scenario.origin_city_m
    walks = [one.outline_m() for one in road_map.crosswalks]
    areas = [one.boundary[:, :2] for one in road_map.drivable_areas]
    for kind, color, rings in ((CROSSWALK, "white", walks), (PAVED, "gray", areas)):
        for number, ring in enumerate(rings):
            yield (
                f'<poly id="{kind}_{number}" type="{kind}" color="{color}" fill="1" '
                f'layer="{int(kind == CROSSWALK) - 1}" shape="{_shape(ring + origin)}"/>'
            )


def _routes(
    scenario: Scenario, network: _Network, types: list[tuple[str, str]]
) -> tuple[list[str], int]:
    """Types of all, routes of vehicles that follow lanes, and the number of the others."""
    kinds = scenario.agents.kinds
    rows = [row for row, kind in enumerate(kinds) if kind in LANE_FOLLOWER_KINDS]
    found = [
        route
        for row in rows
        if (route := _route(scenario, network, row, types[row][0])) is not None
    ]
    lines = [*dict(types).values(), *(line for _, line in sorted(found))]
    return lines, len(rows) - len(found)


def _route(
    scenario: Scenario, network: _Network, row: int, type_id: str
) -> tuple[int, str] | None:
    """First step and element of a vehicle; None if it does not follow lanes."""
    agents, step_s = scenario.agents, scenario.time_axis.step_s
    steps = np.flatnonzero(agents.is_valid[row])
    heading = agents.heading_rad[row, steps]
    match = nearest_lanes(
        scenario.road_map,
        agents.position_m[row, steps],
        heading_rad=heading,
        kinds=lane_kinds_of(agents.kinds[row]),
    )
    turn = np.abs(wrap_angle(heading - match.heading_rad))
    follows = match.is_valid & (match.distance_m < ON_LANE_M) & (turn < MAX_TURN_RAD)
    if not len(steps) or not follows.all():
        return None
    vehicle_class = _CLASSES[agents.kinds[row]]
    places = [network.place_of[one] for one in match.lane_id.tolist()]
    after = network.edges_after(vehicle_class)
    path = _path([edge for edge, _ in places], after)
    if path and network.is_inside(network.groups[path[-1]][0]):
        path += sorted(after[path[-1]])[:1]
    for n, (edge, index) in enumerate(places if path else ()):
        lane, rest = (
            network.groups[edge][index],
            path[path.index(edge) :] if edge in path else [],
        )
        # SUMO refuses to start on a lane that is not for the vehicle, or from which the
        # route cannot go on.
        is_admitted = vehicle_class in ALLOWED_ON[lane.kind].split()
        goes_on = network.edges_after_lane(lane, vehicle_class)
        if rest and is_admitted and (len(rest) == 1 or rest[1] in goes_on):
            length = network.length_m(edge)
            at = match.along_m[n] * length / arc_length(lane.centerline_m)[-1]
            at = min(at + agents.size_m[row, 0] / 2, length - 0.1)
            speed = np.hypot(*agents.velocity_mps[row, steps[n]])
            # Between edges SUMO finds internal ones itself.
            names = [network.edge_name(one) for one in rest]
            names = [name for name in names if name[0] == "e" or name == names[0]]
            return int(steps[n]), (
                f'<vehicle id="{_as_id(agents.ids[row])}" type="{type_id}" '
                f'depart="{steps[n] * step_s:.2f}" departLane="{index}" '
                f'departPos="{at:.2f}" departSpeed="{speed:.2f}" '
                'insertionChecks="collision leaderGap followerGap">'
                f'<route edges="{" ".join(names)}"/></vehicle>'
            )
    return None


def _path(nearest: list[int], after: dict[int, set[int]]) -> list[int]:
    """Linked edges from the first to the last of those that are nearest; none if unlinked.

    As few as possible are edges that were never nearest.
    """
    known, seen = set(nearest), set()
    growing = [(0, 1, [nearest[0]])]
    while growing:
        unknown, _, path = heappop(growing)
        if path[-1] == nearest[-1]:
            return path
        if path[-1] not in seen and unknown <= _MAX_UNSEEN:
            seen.add(path[-1])
            for one in sorted(after[path[-1]]):
                entry = (unknown + (one not in known), len(path), [*path, one])
                heappush(growing, entry)
    return []
