"""Writes scenes as SUMO networks with floating-car data and routes."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from heapq import heappop, heappush
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.formats.scene_format import WrittenScene
from pd_editor.scene.formats.sumo_net import ALLOWED_ON, CROSSWALK, JUNCTION, PAVED
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.polyline import arc_length, resample
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import (
    MAX_TURN_RAD,
    ON_LANE_M,
    lane_kinds_of,
)
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scenario import Scenario

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
    "Lane markings, elevations, and right of way where lanes cross.",
    "Speed limits: all lanes have the same, since scenes have none.",
    "Motion of routes: they begin as recorded, and SUMO drives them its own way; the "
    "floating-car data have the recorded motion.",
    "Benchmark categories, made-up pasts, and which agent is the focal one.",
)


def write(scenario: Scenario) -> WrittenScene:
    """Files of a network with every lane as it is, of the motion, and of routes.

    A lane is a lane of an edge that it shares with its neighbours. Edges meet without
    lanes through the junction, so that geometry and links are exact. Coordinates are
    those of the city, times those since the first step.
    """
    name, axis = scenario.scenario_id, scenario.time_axis
    network = _Network(scenario)
    types = _types(scenario)
    routes, left_out = _routes(scenario, network, types)
    losses: list[str] = list(_LOSSES)
    if left_out:
        losses.append(f"Routes of {left_out} vehicles that do not follow lanes.")
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
    table = [f"lane {number},{other}" for number, other in network.name_of.items()]
    table += [f"agent {one},{_as_id(one)}" for one in scenario.agents.ids]
    table += [f"signal {one.signal_id},tl{n}" for n, one in enumerate(scenario.signals)]
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
    files["ids.csv"] = "\n".join(["ours,sumo", *table, ""])
    return WrittenScene(
        files={name: text.encode() for name, text in files.items()},
        losses=tuple(losses),
    )


class _Network:
    """Edges of neighbouring lanes, and junctions of no size between them."""

    def __init__(self, scenario: Scenario) -> None:
        known, self._origin = scenario.road_map.lane_of, scenario.origin_city_m
        self.groups = [[known[n] for n in g] for g in scenario.road_map.lane_groups]
        self.place_of = {
            lane.lane_id: (edge, index)
            for edge, group in enumerate(self.groups)
            for index, lane in enumerate(group)
        }
        self.name_of = {n: f"e{one}_{two}" for n, (one, two) in self.place_of.items()}
        self.after = {
            n: [known[m] for m in dict.fromkeys(lane.successors) if m in known]
            for n, lane in known.items()
        }
        self._signals, self._step_s = scenario.signals, scenario.time_axis.step_s
        self.light_of = self._light_of()
        """Signal and index of the links that obey one, by their lanes."""
        speed = np.hypot(*scenario.agents.velocity_mps.reshape(-1, 2).T)
        self.speed_mps = float(max(_LEAST_SPEED_MPS, speed.max(initial=0.0) + 0.1))
        self._parent = list(range(2 * len(self.groups)))
        for number, following in self.after.items():
            for one in following:
                end = self._junction(2 * self.place_of[number][0] + 1)
                start = self._junction(2 * self.place_of[one.lane_id][0])
                self._parent[end] = start

    def _junction(self, end: int) -> int:
        """Junction of an edge's start (even numbers) or end (odd ones)."""
        while self._parent[end] != end:
            self._parent[end] = self._parent[self._parent[end]]
            end = self._parent[end]
        return end

    def _light_of(self) -> dict[tuple[int, int], tuple[int, int]]:
        links = [(n, one.lane_id) for n, after in self.after.items() for one in after]
        found: dict[tuple[int, int], tuple[int, int]] = {}
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
        count = Counter(number for number, _ in self.light_of.values())
        for number, links in count.items():
            yield f'<tlLogic id="tl{number}" type="static" programID="0" offset="0">'
            for state, duration in self._signals[number].phases(self._step_s):
                letters = WORDS[state][2] * links
                yield f'<phase duration="{duration:.2f}" state="{letters}"/>'
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
        for end in range(2 * len(self.groups)):
            ends[self._junction(end)].append(end)
        for junction, here in ends.items():
            yield from self._junction_lines(junction, here)
        for number, following in self.after.items():
            for one in following:
                (start, lane), (end, its_lane) = (
                    self.place_of[n] for n in (number, one.lane_id)
                )
                light = self.light_of.get((number, one.lane_id))
                told = 'state="M"'
                if light is not None:
                    told = f'tl="tl{light[0]}" linkIndex="{light[1]}" state="o"'
                yield (
                    f'<connection from="e{start}" to="e{end}" fromLane="{lane}" '
                    f'toLane="{its_lane}" dir="s" {told}/>'
                )

    def _edge(self, edge: int, group: list[Lane]) -> Iterator[str]:
        start, end = self._junction(2 * edge), self._junction(2 * edge + 1)
        kind = JUNCTION if any(one.is_intersection for one in group) else "road"
        yield (
            f'<edge id="e{edge}" from="j{start}" to="j{end}" priority="1" type="{kind}">'
        )
        for index, lane in enumerate(group):
            across = resample(lane.left_m, 9) - resample(lane.right_m, 9)
            yield (
                f'<lane id="e{edge}_{index}" index="{index}" '
                f'allow="{ALLOWED_ON[lane.kind]}" speed="{self.speed_mps:.2f}" '
                f'length="{self.length_m(edge):.4f}" '
                f'width="{np.median(np.hypot(*across.T)):.3f}" '
                f'shape="{_shape(lane.centerline_m + self._origin)}"/>'
            )
        yield "</edge>"

    def _junction_lines(self, junction: int, ends: list[int]) -> Iterator[str]:
        touching = [(lane, end % 2) for end in ends for lane in self.groups[end // 2]]
        arriving = [lane for lane, arrives in touching if arrives]
        links = [(lane, one) for lane in arriving for one in self.after[lane.lane_id]]
        points = [lane.centerline_m[-1 if last else 0] for lane, last in touching]
        place = np.mean(points, axis=0) + self._origin
        names = " ".join(self.name_of[lane.lane_id] for lane in arriving)
        obeys = any((a.lane_id, b.lane_id) in self.light_of for a, b in links)
        kind = "traffic_light" if obeys else "priority" if links else "dead_end"
        yield (
            f'<junction id="j{junction}" type="{kind}" '
            f'x="{place[0]:.4f}" y="{place[1]:.4f}" incLanes="{names}" intLanes="" '
            f'shape="{_shape(place[None])}">'
        )
        turns = [_turn(lane) for lane, _ in links]
        for row, (lane, after) in enumerate(links):
            # Of lanes that merge, the straightest has priority.
            foes = [one is not lane and end is after for one, end in links]
            gives = [
                foe and (turns[n], n) < (turns[row], row) for n, foe in enumerate(foes)
            ]
            yield (
                f'<request index="{row}" response="{_bits(gives)}" '
                f'foes="{_bits(foes)}" cont="0"/>'
            )
        yield "</junction>"


def _turn(lane: Lane) -> float:
    """By how much a lane turns in all."""
    steps = np.diff(lane.centerline_m, axis=0)
    turn = np.diff(heading_of(steps[[0, -1]]))
    return float(np.abs(wrap_angle(turn))[0])


def _bits(flags: Iterable[bool]) -> str:
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
        yield f'<timestep time="{step * axis.step_s:.2f}">'
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
    path = _path([edge for edge, _ in places], network.edges_after(vehicle_class))
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
            return int(steps[n]), (
                f'<vehicle id="{_as_id(agents.ids[row])}" type="{type_id}" '
                f'depart="{steps[n] * step_s:.2f}" departLane="{index}" '
                f'departPos="{at:.2f}" departSpeed="{speed:.2f}">'
                f'<route edges="{" ".join(f"e{one}" for one in rest)}"/></vehicle>'
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
