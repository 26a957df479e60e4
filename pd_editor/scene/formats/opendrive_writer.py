"""Writes roads as OpenDRIVE 1.7 networks: a road is a lane, or neighbours side by side.

The reference line of a road goes smoothly along its middle lane; at its ends it stands
across the line on which its lanes end. Roads that follow each other alone are linked
directly. Where lanes part or merge, the roads before end a little earlier, and connecting
roads of a junction bridge the way; all roads that meet there have one heading.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import ExportError
from pd_editor.base.plain_text import csv_file
from pd_editor.scene.formats.openscenario import (
    entity_names,
    light_ids,
    openscenario_file,
)
from pd_editor.scene.formats.scene_format import IDS_NAME, WrittenScene, losses_of
from pd_editor.scene.formats.xml_file import EDITOR, added, as_file
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.polyline import arc_length, midline, without_repeats
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario

ROAD_MARKS: Final = {
    LaneMark.SOLID_WHITE: ("solid", "white"),
    LaneMark.SOLID_YELLOW: ("solid", "yellow"),
    LaneMark.SOLID_BLUE: ("solid", "blue"),
    LaneMark.DASHED_WHITE: ("broken", "white"),
    LaneMark.DASHED_YELLOW: ("broken", "yellow"),
    LaneMark.DOUBLE_SOLID_WHITE: ("solid solid", "white"),
    LaneMark.DOUBLE_SOLID_YELLOW: ("solid solid", "yellow"),
    LaneMark.DOUBLE_DASH_WHITE: ("broken broken", "white"),
    LaneMark.DOUBLE_DASH_YELLOW: ("broken broken", "yellow"),
    LaneMark.SOLID_DASH_WHITE: ("solid broken", "white"),
    LaneMark.SOLID_DASH_YELLOW: ("solid broken", "yellow"),
    LaneMark.DASH_SOLID_WHITE: ("broken solid", "white"),
    LaneMark.DASH_SOLID_YELLOW: ("broken solid", "yellow"),
    LaneMark.NONE: ("none", "white"),
}
"""Types and colours of road marks; unknown markings are left out."""
PAVING: Final = "asphalt"
"""What fills the outlines of objects that are drivable areas."""
LEFT: Final = "pd-editor left neighbor"
RIGHT: Final = "pd-editor right neighbor"
INTERSECTION: Final = "pd-editor intersection"
"""Codes of user data of lanes: roads of neighbours, and whether it is in an intersection."""
JOINT_M: Final = 0.1
JOINT: Final = "pd-editor joint"
"""Connecting roads that are shorter, or have user data of this code, only join lanes."""
End = tuple[int, int]
"""Id of a road or a lane, and 0 for its first point or 1 for its last one."""
Links = Sequence[tuple[int, int]]
"""Ids of lanes of which the second one follows the first one."""
Place = tuple[int, int]
"""Ids of a road and of a lane in it."""
_LANE_TYPES: Final = {
    LaneKind.VEHICLE: "driving",
    LaneKind.BIKE: "biking",
    LaneKind.BUS: "bus",
}
_BRIDGE_M: Final = 0.025
"""Length of connecting roads."""
_SAME_LINE_M: Final = 0.005
_STRAIGHT: Final = 1e-3
_SHARPEST: Final = 2.5
"""Corners of smaller and of larger angles are not rounded."""
_SAME_VALUE_M: Final = 0.005
_SAME_SLOPE: Final = 1e-9
_LEAST_WIDTH_M: Final = 0.05
_STATION_M: Final = 1.0
_MOST_ASKEW: Final = 0.5
"""Angle by which lanes of one road may end askew, at most."""
_MOST_GAP_M: Final = 0.02
_MOST_WIDER_M: Final = 0.3
"""How much places and widths of a road's lanes may differ from the scene's."""
_SHAPES: Final = ((0.3, 2.0, 10.0), (0.05, 0.5, 3.0), (_SAME_LINE_M, 0.03, 1.0))
"""How far reference lines may leave lanes, and lie aside on the way to the heading at an end,
and how long that way may be. A single lane has the last one if no other fits."""


@dataclass(frozen=True, eq=False)
class _Road:
    """Lanes from left to right with M borders, known at K stations along the road."""

    lane_ids: tuple[int, ...]
    pieces: Float[np.ndarray, "P 6"]
    """Lines and arcs: s, x, y, heading, length, curvature; first and last are lines."""
    s_m: Float[np.ndarray, "K"]
    border_m: Float[np.ndarray, "K M"]
    height_m: Float[np.ndarray, "K"]

    def cut(self) -> tuple["_Road", "_Road"]:
        """The road without its last centimetres, and these."""
        start, x, y, heading, length, _ = self.pieces[-1]
        kept_m = length - min(_BRIDGE_M, length / 2)
        last = np.array([[start, x, y, heading, kept_m, 0.0]])
        x, y = (x, y) + kept_m * unit_vector(heading)
        rest = np.array([[0.0, x, y, heading, length - kept_m, 0.0]])
        pieces = np.concatenate([self.pieces[:-1], last])
        s, ends = np.append(self.s_m[:-1], start + kept_m), rest[0, [0, 4]]
        values = self.border_m[[-1, -1]], self.height_m[[-1, -1]]
        kept = replace(self, pieces=pieces, s_m=s)
        return kept, _Road(self.lane_ids, rest, ends, *values)


_LOSSES: Final[tuple[str, ...]] = (
    "Boundaries: a lane lies evenly on both sides of its centre line, which may move a "
    "boundary by some centimetres, and its ends are square; neighbours have one marking "
    "between them.",
    "Markings whose kind is unknown, and heights of crosswalks, drivable areas, and of "
    "lanes beside the middle one of a road.",
    "Velocities: they follow from the places and times of a trajectory.",
)
_KEEPS: Final = frozenset(
    {"signals", "signal names", "shared signals", "links", "neighbors", "oncoming"}
    | {"lane kinds", "junctions", "marks", "heights", "crosswalks", "paved"}
)


def write(scenario: Scenario) -> WrittenScene:
    """Files of a scenario: roads as OpenDRIVE 1.7, agents as OpenSCENARIO 1.2, and ids.

    Times are counted from the first step. A scene without agents is the roads alone.

    Raises:
        ExportError: a lane has no length.
    """
    name, roads = scenario.scenario_id, _roads(scenario.road_map)
    places = {
        lane: (number, -place)
        for number, road in roads.items()
        for place, lane in enumerate(road.lane_ids, start=1)
    }
    untold, count = _untold(scenario.road_map, places)
    files = {f"{name}.xodr": _file(scenario, roads, places, untold)}
    names = entity_names(scenario.agents.ids)
    if names:
        files[f"{name}.xosc"] = openscenario_file(scenario, f"{name}.xodr", names)
    rows = [("kind", "id", "id in the file")]
    rows += [("agent", *pair) for pair in names.items()]
    rows += [
        ("lane", str(one), "{} {}".format(*places[one]))
        for one in scenario.road_map.lane_of
    ]
    rows += [("signal", key[0], str(one)) for key, one in light_ids(scenario).items()]
    files[IDS_NAME] = csv_file(rows)
    only = "only this editor reads that, as user data."
    own = f"Which lanes are in an intersection: {only}"
    askew = f"{len(untold)} of {count} neighbours end askew or go the other way: {only}"
    unsaid = ("States of signals.",) if scenario.signals and not names else ()
    told = (*[askew] * bool(untold), own, *_LOSSES, *unsaid)
    return WrittenScene(
        files=files,
        losses=losses_of(scenario, *told, keeps=_KEEPS),
        renamed={one: names[one] for one in names if one != EGO_ID},
    )


def _untold(
    road_map: RoadMap, places: Mapping[int, Place]
) -> tuple[dict[tuple[int, str], str], int]:
    """Neighbours of lanes that are not beside them in a road; the number of all."""
    beside = [
        ((number, code), places[other], (places[number][0], places[number][1] + step))
        for number, lane in road_map.lane_of.items()
        for code, step, other in (
            (LEFT, 1, lane.left_neighbor),
            (RIGHT, -1, lane.right_neighbor),
        )
        if other is not None and other in places
    ]
    untold = {key: "{} {}".format(*one) for key, one, told in beside if one != told}
    return untold, len(beside)


def _file(
    scenario: Scenario,
    roads: dict[int, _Road],
    places: Mapping[int, Place],
    untold: Mapping[tuple[int, str], str],
) -> bytes:
    """The road network of a scenario in its frame; the header tells the frame's origin.

    Ids of junctions, connecting roads and objects come after those of lanes.
    """
    road_map, root = scenario.road_map, etree.Element("OpenDRIVE")
    _header(root, scenario)
    lights = light_ids(scenario)
    ids = count(1 + max(road_map.lane_of) + len(lights))
    road_of = {lane: road for lane, (road, _) in places.items()}
    beyond: dict[End, Place] = {}
    junctions: dict[int, Links] = {}
    for links in _joints(road_map, road_of):
        if _fit(roads, [(places[one], places[other]) for one, other in links]):
            beyond |= {(one, 1): places[other] for one, other in links}
            beyond |= {(other, 0): places[one] for one, other in links}
        else:
            junctions[next(ids)] = links
    junction_of: dict[End, int] = {}
    for number, links in junctions.items():
        junction_of |= dict.fromkeys(_ends(links, road_of), number)
    bridges: dict[int, _Road] = {}
    for road in [road for road, end in junction_of if end]:
        roads[road], bridges[road] = roads[road].cut()
    objects = _objects(road_map, roads, road_of, ids)
    for number, road in roads.items():
        there = [
            junction_of.get((number, end))
            or [beyond.get((lane, end)) for lane in road.lane_ids]
            for end in (0, 1)
        ]
        lanes = [road_map.lane_of[one] for one in road.lane_ids]
        found = _road(root, (number, -1), lanes, road, there)
        for lane, place in zip(lanes, found.findall(".//right/lane"), strict=True):
            if lane.is_intersection:
                added(place, "userData", code=INTERSECTION, value=True)
            for code in (LEFT, RIGHT):
                if told := untold.get((lane.lane_id, code)):
                    added(place, "userData", code=code, value=told)
        if number in objects:
            found.append(objects[number])
        _lights(found, scenario, road)
    found = _connect(root, road_map, roads, places, bridges, junctions, ids)
    for number, one in enumerate(scenario.signals):
        controller = added(root, "controller", id=number, name=one.signal_id)
        for lane in one.lane_ids:
            added(controller, "control", signalId=lights[one.signal_id, lane], type="")
    root.extend(found)
    return as_file(root)


def _header(root: etree._Element, scenario: Scenario) -> None:
    (west, south), (east, north) = scenario.road_map.bounds_m
    about = {"name": scenario.scenario_id, "vendor": EDITOR}
    bounds = {"north": north, "south": south, "east": east, "west": west}
    header = added(root, "header", revMajor=1, revMinor=7, **about, **bounds)
    x, y = scenario.origin_city_m
    added(header, "offset", x=x, y=y, z=0, hdg=0)
    if told := scenario.provenance.attribution:
        added(header, "userData", code="source", value=told)


def _lights(place: etree._Element, scenario: Scenario, road: _Road) -> None:
    """Add the lights of a road's lanes, at their stop lines on the right."""
    lights = light_ids(scenario)
    signals = etree.Element("signals")
    for one in scenario.signals:
        for number, share in zip(one.lane_ids, one.stop_share.tolist(), strict=True):
            if number in road.lane_ids:
                lane, s = -road.lane_ids.index(number) - 1, share * road.s_m[-1]
                beside = np.interp(s, road.s_m, road.border_m[:, -lane])
                about = {"id": lights[one.signal_id, number], "dynamic": "yes"}
                about |= {"orientation": "+", "zOffset": 5, "country": "OpenDRIVE"}
                about |= {"type": 1000001, "subtype": -1, "s": s, "t": beside}
                light = added(signals, "signal", **about)
                added(light, "validity", fromLane=lane, toLane=lane)
    if len(signals):
        place.append(signals)


def _fit(roads: Mapping[int, _Road], links: Sequence[tuple[Place, Place]]) -> bool:
    """Whether all links are of two roads side by side, which then get the same borders."""
    (road, _), (its_road, _) = links[0]
    one, other = roads[road], roads[its_road]
    lane, its_lane = -np.array([[place for _, place in pair] for pair in links]).T
    ahead, aside = _step_m(one, other)
    if (
        any((before[0], after[0]) != (road, its_road) for before, after in links)
        or len(np.unique(lane)) < len(lane)
        or np.ptp(lane - its_lane)
        or abs(ahead) > _SAME_VALUE_M
    ):
        return False
    here, there = (np.union1d(n, n - 1) for n in (lane, its_lane))
    mean = (one.border_m[-1, here] + other.border_m[0, there] + aside) / 2
    one.border_m[-1, here], other.border_m[0, there] = mean, mean - aside
    return True


def _step_m(one: _Road, other: _Road) -> tuple[float, float]:
    """How far ahead, and to the left, of a road's end another one begins."""
    x, y, heading, length, _ = one.pieces[-1, 1:].tolist()
    ahead = unit_vector(heading)
    step = other.pieces[0, 1:3] - (x, y) - length * ahead
    return float(step @ ahead), float(step @ left_of(ahead))


def _joints(road_map: RoadMap, road_of: Mapping[int, int]) -> list[Links]:
    """Links of lanes, in groups that share an end of a road."""
    links = {
        pair
        for number, lane in road_map.lane_of.items()
        for pair in (
            *((number, one) for one in lane.successors if one in road_of),
            *((one, number) for one in lane.predecessors if one in road_of),
        )
    }
    group: dict[End, Links] = {}
    for link in sorted(links):
        merged = [link]
        for end in _ends([link], road_of):
            merged += [one for one in group.get(end, ()) if one not in merged]
        group |= dict.fromkeys(_ends(merged, road_of), merged)
    return [sorted(one) for one in {id(one): one for one in group.values()}.values()]


def _ends(links: Links, road_of: Mapping[int, int]) -> list[End]:
    """Ends of roads that links join."""
    pairs = [((road_of[one], 1), (road_of[other], 0)) for one, other in links]
    return list(dict.fromkeys(end for pair in pairs for end in pair))


def _roads(road_map: RoadMap) -> dict[int, _Road]:
    """Roads by the ids of their left lanes; those that meet have one heading."""
    lines = {number: _center(lane) for number, lane in road_map.lane_of.items()}
    groups = dict(enumerate(_groups(road_map, lines)))
    group_of = {lane: number for number, group in groups.items() for lane in group}
    own = {
        (number, end): _across([lines[lane] for lane in group], end)
        for number, group in groups.items()
        for end in (0, 1)
    }
    turns = {end: way for end, way in own.items() if len(groups[end[0]]) > 1}
    for links in _joints(road_map, group_of):
        ends = _ends(links, group_of)
        ways = np.array([own[one] for one in turns.keys() & {*ends} or ends])
        mean = ways.sum(axis=0)
        turns |= dict.fromkeys(ends, mean if np.hypot(*mean) > _STRAIGHT else ways[0])
    found: list[_Road | None] = []
    for number, group in groups.items():
        ways = [turns.get((number, end)) for end in (0, 1)]
        turn = [None if way is None else float(np.arctan2(*way[::-1])) for way in ways]
        whole = _fitted(road_map, lines, group, turn)
        parts = group if whole is None else ()
        found += [whole, *(_fitted(road_map, lines, (lane,), turn) for lane in parts)]
    return {road.lane_ids[0]: road for road in found if road is not None}


def _groups(
    road_map: RoadMap, lines: Mapping[int, Float[np.ndarray, "_ 2"]]
) -> Iterator[tuple[int, ...]]:
    """Ids of lanes, from left to right, that may be one road."""
    for ids in road_map.lane_groups:
        group: list[int] = []
        for lane in reversed(ids):
            if not _end_alike([lines[one] for one in (*group, lane)]):
                yield tuple(group)
                group = []
            group.append(lane)
        yield tuple(group)


def _end_alike(lines: Sequence[Float[np.ndarray, "_ 2"]]) -> bool:
    """Whether lanes end on a line that is not too much askew, at both ends."""
    for end in (0, 1):
        across = _across(lines, end)
        steps = np.array([_across([line], end) for line in lines])
        places = np.array([line[-end, :2] for line in lines])
        if (steps @ across).min() < np.cos(_MOST_ASKEW):
            return False
        if np.ptp(places @ across) > _MOST_GAP_M:
            return False
    return True


def _across(
    lines: Sequence[Float[np.ndarray, "_ _"]], end: int
) -> Float[np.ndarray, "2"]:
    """Direction across the line on which lanes end; of a single lane its own."""
    if len(lines) > 1:
        return -left_of(_direction(lines[0][-end, :2] - lines[-1][-end, :2]))
    return _direction(np.diff(lines[0][-2 * end :][:2, :2], axis=0)[0])


def _direction(step: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    return step / max(float(np.hypot(*step)), 1e-9)


def _fitted(
    road_map: RoadMap,
    lines: Mapping[int, Float[np.ndarray, "_ 2"]],
    lane_ids: tuple[int, ...],
    headings: Sequence[float | None],
) -> _Road | None:
    """A road of lanes; None if it would move any of them."""
    centers = [lines[one] for one in lane_ids]
    lanes = [road_map.lane_of[one] for one in lane_ids]
    middle, is_single = lines[lane_ids[len(lanes) // 2]], len(lanes) == 1
    for away_m, *most in _SHAPES if is_single else _SHAPES[:-1]:
        line = shapely.simplify(shapely.LineString(middle), away_m)
        line = _turned(shapely.get_coordinates(line), headings, *most)
        pieces = _pieces(line, 4 * away_m)
        s, place = _stations(pieces)
        points, ahead = place[:, :2], unit_vector(place[:, 2])
        beside = np.stack([_beside(one, points, ahead) for one in centers], axis=-1)
        lateral = np.where(np.isfinite(beside), beside, 0.0)
        found = points[:, None] + lateral[..., None] * left_of(ahead)[:, None]
        width = _widths(lanes, found)
        border = _borders(lateral, width)
        goes_on = (np.diff(found, axis=0) * ahead[:-1, None]).sum(axis=-1) > 0
        gaps = [
            shapely.hausdorff_distance(shapely.LineString(one), shapely.LineString(its))
            for one, its in zip(found.swapaxes(0, 1), centers, strict=True)
        ]
        is_right = (
            np.isfinite(beside).all()
            and goes_on.all()
            and (np.abs(np.diff(border) + width) < _MOST_WIDER_M).all()
            and max(gaps) < _MOST_GAP_M
        )
        if is_right or (is_single and away_m == _SAME_LINE_M):
            # Center lines of Argoverse 2 are at height 0, whatever their boundaries are.
            bounds = lanes[len(lanes) // 2]
            between = midline(bounds.left, bounds.right)
            way = arc_length(between[:, :2])
            height = np.interp(s * way[-1] / s[-1], way, between[:, 2])
            return _Road(lane_ids, pieces, s, border, height)
    return None


def _beside(
    line: Float[np.ndarray, "N 2"],
    points_m: Float[np.ndarray, "K 2"],
    ahead: Float[np.ndarray, "K 2"],
) -> Float[np.ndarray, "K"]:
    """Lateral places at which a line goes by some points; infinite where it does not.

    It is thought to go on a little at its ends.
    """
    ends = (
        line[0] - JOINT_M * _across([line], 0),
        line[-1] + JOINT_M * _across([line], 1),
    )
    way = np.vstack([ends[0], line, ends[1]]) - points_m[:, None]
    along, lateral = (
        (way * one[:, None]).sum(axis=-1) for one in (ahead, left_of(ahead))
    )
    goes_by = (along[:, :-1] <= 0) & (along[:, 1:] > 0)
    share = -along[:, :-1] / np.where(goes_by, np.diff(along), 1.0)
    found = lateral[:, :-1] + share * np.diff(lateral)
    found = np.where(goes_by, found, np.inf)
    return found[np.arange(len(found)), np.abs(found).argmin(axis=1)]


def _borders(
    lateral_m: Float[np.ndarray, "K N"], width_m: Float[np.ndarray, "K N"]
) -> Float[np.ndarray, "K M"]:
    """Borders of lanes whose middles are given, about as wide as given."""
    border = np.zeros((len(lateral_m), lateral_m.shape[1] + 1))
    for n, middle in enumerate(lateral_m.T):
        border[:, n + 1] = 2 * middle - border[:, n]
    # What one border is moved by, the next ones are in turn.
    sign = (-1.0) ** np.arange(border.shape[1])
    share = sign[:-1] * (width_m + np.diff(border)) / 2
    return border + sign * share.mean(axis=1, keepdims=True)


def _center(lane: Lane) -> Float[np.ndarray, "N 2"]:
    line = without_repeats(lane.centerline[:, :2])
    if len(line) < 2:
        raise ExportError(
            f"Lane {lane.lane_id} has no length; a road of OpenDRIVE needs one."
        )
    kept = shapely.simplify(shapely.LineString(lane.centerline_m), _SAME_LINE_M)
    return shapely.get_coordinates(kept)


def _turned(
    line: Float[np.ndarray, "N 2"],
    headings: Sequence[float | None],
    aside_m: float,
    most_m: float,
) -> Float[np.ndarray, "M 2"]:
    """The line with a short way of a given heading at each end that has one."""
    # Twice, since on a single straight the first end's way turns the last end.
    for heading, sign in zip((*headings[::-1],) * 2, (-1.0, 1.0) * 2, strict=True):
        line = line[::-1]
        if heading is None:
            continue
        step, way = line[1] - line[0], sign * unit_vector(heading)
        aside, ahead = step @ left_of(way), step @ way
        if abs(np.arctan2(aside, ahead)) > _STRAIGHT:
            length = float(np.hypot(*step))
            reach = min(aside_m * length / max(abs(aside), 1e-9), 0.4 * length, most_m)
            line = np.vstack([line[:1], line[:1] + reach * way, line[1:]])
    return line


def _pieces(
    line: Float[np.ndarray, "N 2"], corner_m: float
) -> Float[np.ndarray, "P 6"]:
    """Lines and arcs along a line with rounded corners."""
    step = np.diff(line, axis=0)
    length, heading = np.hypot(*step.T), heading_of(step)
    ahead, turn = unit_vector(heading), wrap_angle(np.diff(heading))
    half = np.maximum(np.abs(turn) / 2, 1e-9)
    is_round = (half > _STRAIGHT / 2) & (half < _SHARPEST / 2)
    # The first and the last straight may be used up; others are shared by two corners.
    share = np.full(len(length), 0.45)
    share[[0, -1]] = 0.8
    most = np.minimum((share * length)[:-1], (share * length)[1:])
    used = np.minimum(corner_m / np.tan(half / 2), most) * is_round
    radius = np.where(is_round, used / np.tan(half), 1.0)
    table = np.zeros((2 * len(length) - 1, 5))
    before, after = np.append(0.0, used), np.append(used, 0.0)
    table[::2, :2] = line[:-1] + before[:, None] * ahead
    table[::2, 2], table[::2, 3] = heading, length - before - after
    table[1::2, :2] = line[1:-1] - used[:, None] * ahead[:-1]
    table[1::2, 2] = heading[:-1]
    table[1::2, 3] = 2 * half * radius * is_round
    table[1::2, 4] = np.sign(turn) / radius * is_round
    table = table[table[:, 3] > 0]
    start = np.cumsum(table[:, 3]) - table[:, 3]
    return np.column_stack([start, table])


def _stations(
    pieces: Float[np.ndarray, "P 6"],
) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
    """Places along a road, and their points and headings."""
    # Beside an arc a straight lane is no linear piece.
    every = np.sqrt(8 * _SAME_VALUE_M / np.maximum(np.abs(pieces[:, 5]), 1e-9))
    number = np.ceil(pieces[:, 4] / np.minimum(every, _STATION_M)).astype(int) + 1
    share = np.concatenate([np.linspace(0.0, 1.0, one) for one in number.tolist()])
    start, x, y, heading, length, curvature = np.repeat(pieces, number, axis=0).T
    along = share * length
    half = curvature * along / 2
    chord = (along * np.sinc(half / np.pi))[:, None] * unit_vector(heading + half)
    place = np.column_stack([x + chord[:, 0], y + chord[:, 1], heading + 2 * half])
    s, kept = np.unique(np.round(start + along, 9), return_index=True)
    return s, place[kept]


def _widths(
    lanes: Sequence[Lane], points_m: Float[np.ndarray, "K N 2"]
) -> Float[np.ndarray, "K N"]:
    """Widths of N lanes at points on their centre lines."""
    points = shapely.points(points_m)
    sides = ([lane.left_m for lane in lanes], [lane.right_m for lane in lanes])
    lines = (np.array([shapely.LineString(one) for one in side]) for side in sides)
    both = [shapely.distance(points, one) for one in lines]
    return np.maximum(sum(both), _LEAST_WIDTH_M)


def _road(
    root: etree._Element,
    name: tuple[int, int],
    lanes: Sequence[Lane],
    road: _Road,
    beyond: Sequence[int | Sequence[Place | None]],
) -> etree._Element:
    """Add a road; its name is its id and that of its junction.

    At each end there is a junction, or maybe another lane before or after each of its own.
    """
    length = road.pieces[-1, 0] + road.pieces[-1, 4]
    found = added(root, "road", name="", length=length, id=name[0], junction=name[1])
    ends = list(
        zip(("predecessor", "successor"), ("end", "start"), beyond, strict=True)
    )
    link = added(found, "link")
    for tag, contact, there in ends:
        if isinstance(there, int):
            added(link, tag, elementType="junction", elementId=there)
        elif known := [one for one, _ in filter(None, there)]:
            about = {"elementId": known[0], "contactPoint": contact}
            added(link, tag, elementType="road", **about)
    plan = added(found, "planView")
    for s, x, y, heading, part, curvature in road.pieces.tolist():
        piece = added(plan, "geometry", s=s, x=x, y=y, hdg=heading, length=part)
        if curvature:
            added(piece, "arc", curvature=curvature)
        else:
            added(piece, "line")
    if road.height_m.any():
        profile = added(found, "elevationProfile")
        _profile(profile, "elevation", road.s_m, road.height_m)
    places = added(found, "lanes")
    _profile(places, "laneOffset", road.s_m, road.border_m[:, 0])
    section = added(places, "laneSection", s=0)
    center = added(added(section, "center"), "lane", id=0, type="none", level="false")
    _mark(center, lanes[0].left_mark)
    right = added(section, "right")
    for n, (lane, width) in enumerate(
        zip(lanes, -np.diff(road.border_m).T, strict=True)
    ):
        about = {"type": _LANE_TYPES[lane.kind], "level": "false"}
        own = added(right, "lane", id=-1 - n, **about)
        link = added(own, "link")
        for tag, _, there in ends:
            if not isinstance(there, int) and (one := there[n]) is not None:
                added(link, tag, id=one[1])
        _profile(own, "width", road.s_m, width)
        _mark(own, lane.right_mark)
    return found


def _profile(
    parent: etree._Element,
    tag: str,
    s_m: Float[np.ndarray, "K"],
    values: Float[np.ndarray, "K"],
) -> None:
    """Linear pieces of values along a road, as few as follow them."""
    name = "sOffset" if tag == "width" else "s"
    kept = np.column_stack([s_m, values])
    if len(kept) > 2:
        line = shapely.simplify(shapely.LineString(kept), _SAME_VALUE_M)
        kept = shapely.get_coordinates(line)
    former = np.inf
    for (s, a), (next_s, next_a) in pairwise(kept.tolist()):
        slope = (next_a - a) / (next_s - s)
        if abs(slope - former) > _SAME_SLOPE:
            added(parent, tag, **{name: s}, a=a, b=slope, c=0, d=0)
        former = slope


def _mark(lane: etree._Element, mark: LaneMark) -> None:
    if mark in ROAD_MARKS:
        kind, color = ROAD_MARKS[mark]
        added(lane, "roadMark", sOffset=0, type=kind, weight="standard", color=color)


def _connect(
    root: etree._Element,
    road_map: RoadMap,
    roads: Mapping[int, _Road],
    places: Mapping[int, Place],
    bridges: Mapping[int, _Road],
    junctions: Mapping[int, Links],
    ids: Iterator[int],
) -> list[etree._Element]:
    """Add the connecting roads; their junctions, which come after them."""
    found = []
    for number, links in junctions.items():
        junction = etree.Element("junction", id=str(number), name="")
        for index, (one, other) in enumerate(links):
            own, before, after = next(ids), places[one], places[other]
            bridge, there = bridges[before[0]], roads[after[0]]
            ahead, aside = _step_m(bridge, there)
            its = there.border_m[0] + aside
            border = [
                line[[-1 - lane, -lane]]
                for line, (_, lane) in ((bridge.border_m[0], before), (its, after))
            ]
            pieces = bridge.pieces.copy()
            pieces[0, 4] = max(pieces[0, 4] + ahead, _SAME_VALUE_M)
            s = np.array([0.0, pieces[0, 4]])
            road = replace(bridge, pieces=pieces, s_m=s, border_m=np.stack(border))
            lanes = [road_map.lane_of[one]]
            bridged = _road(root, (own, number), lanes, road, ([before], [after]))
            if s[-1] >= JOINT_M:
                added(bridged, "userData", code=JOINT, value=True)
            way = {"incomingRoad": before[0], "connectingRoad": own}
            way = added(junction, "connection", id=index, contactPoint="start", **way)
            added(way, "laneLink", **{"from": before[1], "to": -1})
        found.append(junction)
    return found


def _objects(
    road_map: RoadMap,
    roads: Mapping[int, _Road],
    road_of: Mapping[int, int],
    ids: Iterator[int],
) -> dict[int, etree._Element]:
    """Crosswalks and drivable areas as objects of the nearest road, by its id."""
    paved = {"fillType": PAVING}
    shapes = [("crosswalk", {}, one.outline_m()) for one in road_map.crosswalks]
    shapes += [("none", paved, one.boundary[:, :2]) for one in road_map.drivable_areas]
    tree = shapely.STRtree(
        [shapely.LineString(lane.centerline_m) for lane in road_map.lanes]
    )
    found: dict[int, etree._Element] = {}
    for kind, filling, ring in shapes:
        middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
        lane = road_map.lanes[int(tree.nearest(shapely.Point(middle)))]
        road = road_of[lane.lane_id]
        lines = roads[road].pieces[roads[road].pieces[:, 5] == 0]
        half = lines[:, 4] / 2
        places = lines[:, 1:3] + half[:, None] * unit_vector(lines[:, 3])
        near = int(np.hypot(*(places - middle).T).argmin())
        ahead = unit_vector(lines[near, 3])
        side = left_of(ahead)
        beside = float((middle - places[near]) @ side)
        local = (ring - places[near] - beside * side) @ np.stack([ahead, side], axis=-1)
        length, width = np.maximum(np.ptp(local, axis=0), 0.01)
        place = {"s": lines[near, 0] + half[near], "t": beside, "zOffset": 0, "hdg": 0}
        size = {"length": length, "width": width, "height": 0}
        objects = found.setdefault(road, etree.Element("objects"))
        about = {"id": next(ids), "type": kind, "orientation": "none"}
        outlines = added(added(objects, "object", **about, **place, **size), "outlines")
        outline = added(outlines, "outline", id=0, closed="true", **filling)
        for u, v in local.tolist():
            added(outline, "cornerLocal", u=u, v=v, z=0, height=0)
    return found
