"""Writes roads as OpenDRIVE 1.7 networks: each lane is a road of its own.

The reference line of a road is the lane's centre line with rounded corners. Lanes that
follow each other alone are linked directly. Where lanes part or merge, the roads before
end a little earlier, and connecting roads of a junction bridge the way; all roads that
meet there have one heading.
"""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import ExportError
from pd_editor.scene.formats.commonroad_writer import IDS_NAME
from pd_editor.scene.formats.openscenario_writer import entity_names, openscenario_file
from pd_editor.scene.formats.scene_format import WrittenScene, losses_of
from pd_editor.scene.formats.xml_file import added, as_file
from pd_editor.scene.geometry.angles import (
    heading_of,
    left_of,
    unit_vector,
    wrap_angle,
)
from pd_editor.scene.geometry.polyline import arc_length, without_repeats
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark, RoadMap
from pd_editor.scene.scenario import Scenario

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
JOINT_M: Final = 0.05
"""Connecting roads that are shorter join lanes, and are none themselves."""
End = tuple[int, int]
"""Row of a lane, and 0 for its first point or 1 for its last one."""
_LANE_TYPES: Final = {
    LaneKind.VEHICLE: "driving",
    LaneKind.BIKE: "biking",
    LaneKind.BUS: "bus",
}
_BRIDGE_M: Final = 0.02
"""Length of connecting roads."""
_SAME_LINE_M: Final = 0.005
_CORNER_M: Final = 0.02
"""Rounded corners are at most so far from the corner."""
_ASIDE_M: Final = 0.03
"""So far the way to the common heading at an end may lie beside the line."""
_STRAIGHT: Final = 1e-3
_SHARPEST: Final = 2.5
"""Corners of smaller and of larger angles are not rounded."""
_SAME_VALUE_M: Final = 0.005
_SAME_SLOPE: Final = 1e-9
_LEAST_WIDTH_M: Final = 0.05
_STATION_M: Final = 2.0


@dataclass(frozen=True, eq=False)
class _Road:
    """Geometry of a road; width and height are linear between K places along it."""

    pieces: Float[np.ndarray, "P 6"]
    """Lines and arcs: s, x, y, heading, length, curvature; first and last are lines."""
    s_m: Float[np.ndarray, "K"]
    width_m: Float[np.ndarray, "K"]
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
        values = self.width_m[[-1, -1]], self.height_m[[-1, -1]]
        return replace(self, pieces=pieces, s_m=s), _Road(rest, ends, *values)


_LOSSES: Final[tuple[str, ...]] = (
    "Neighbours, and which lanes are in an intersection: each lane is a road of its own, "
    "junctions are where lanes part or merge. Only this editor reads both, as user data.",
    "Boundaries: a lane is as wide as ours, and lies evenly on both sides of its centre "
    "line, which may move a boundary by some centimetres.",
    "Markings whose kind is unknown, and heights of crosswalks and drivable areas.",
    "Velocities: they follow from the places and times of a trajectory.",
    "Kinds of static objects, benchmark categories, made-up pasts, the current step, "
    "and which agent is the focal one.",
)


def write(scenario: Scenario) -> WrittenScene:
    """Files of a scenario: roads as OpenDRIVE 1.7, agents as OpenSCENARIO 1.2, and ids.

    Times are counted from the first step. A scene without agents is the roads alone.

    Raises:
        ExportError: a lane has no length.
    """
    name = scenario.scenario_id
    files = {f"{name}.xodr": opendrive_file(scenario)}
    names = entity_names(scenario.agents.ids)
    if names:
        files[f"{name}.xosc"] = openscenario_file(scenario, f"{name}.xodr", names)
    table = io.StringIO()
    rows = [("kind", "id", "id in the file")]
    rows += [("agent", *pair) for pair in names.items()]
    rows += [("lane", str(one), str(one)) for one in scenario.road_map.lane_of]
    csv.writer(table, lineterminator="\n").writerows(rows)
    files[IDS_NAME] = table.getvalue().encode()
    return WrittenScene(files=files, losses=losses_of(scenario, *_LOSSES))


def opendrive_file(scenario: Scenario) -> bytes:
    """The road network of a scenario in its frame; the header tells the frame's origin.

    Ids of roads are those of lanes; those of junctions, connecting roads and objects
    come after them.

    Raises:
        ExportError: a lane has no length.
    """
    lanes, origin = scenario.road_map.lanes, scenario.origin_city_m
    root = etree.Element("OpenDRIVE")
    (west, south), (east, north) = scenario.road_map.bounds_m
    about = {"name": scenario.scenario_id, "vendor": "Path Diffuser Editor"}
    bounds = {"north": north, "south": south, "east": east, "west": west}
    header = added(root, "header", revMajor=1, revMinor=7, **about, **bounds)
    added(header, "offset", x=origin[0], y=origin[1], z=0, hdg=0)
    joints = _joints(scenario.road_map)
    roads = _roads(lanes, joints)
    ids = count(1 + max(lane.lane_id for lane in lanes))
    junctions = [(next(ids), links) for links in joints if len(links) > 1]
    linked: dict[End, dict[str, object]] = {}
    for links in joints:
        for one, other in links:
            linked[one, 1] = _to_road(lanes[other], "start")
            linked[other, 0] = _to_road(lanes[one], "end")
    bridges: dict[int, _Road] = {}
    for number, links in junctions:
        here: dict[str, object] = {"elementType": "junction", "elementId": number}
        linked |= dict.fromkeys(_ends(links), here)
        for one in {one for one, _ in links}:
            roads[one], bridges[one] = roads[one].cut()
    objects = _objects(scenario.road_map, roads, ids)
    for row, (lane, road) in enumerate(zip(lanes, roads, strict=True)):
        found = [linked.get((row, end)) for end in (0, 1)]
        place = _road(root, (lane.lane_id, -1), lane, road, found)
        _tell(place, lane)
        if row in objects:
            place.append(objects[row])
    _connect(root, lanes, roads, bridges, junctions, ids)
    return as_file(root)


def _to_road(lane: Lane, contact: str) -> dict[str, object]:
    return {"elementType": "road", "elementId": lane.lane_id, "contactPoint": contact}


def _joints(road_map: RoadMap) -> list[list[tuple[int, int]]]:
    """Links of rows of lanes, in groups that share an end of a lane."""
    row_of = {lane.lane_id: row for row, lane in enumerate(road_map.lanes)}
    links = {
        pair
        for row, lane in enumerate(road_map.lanes)
        for pair in (
            *((row, row_of[one]) for one in lane.successors if one in row_of),
            *((row_of[one], row) for one in lane.predecessors if one in row_of),
        )
    }
    group: dict[End, list[tuple[int, int]]] = {}
    for link in sorted(links):
        merged = [link]
        for end in _ends([link]):
            merged += [one for one in group.get(end, ()) if one not in merged]
        group |= dict.fromkeys(_ends(merged), merged)
    return [sorted(one) for one in {id(one): one for one in group.values()}.values()]


def _ends(links: Sequence[tuple[int, int]]) -> list[End]:
    """Ends of lanes that links join."""
    found = [end for one, other in links for end in ((one, 1), (other, 0))]
    return list(dict.fromkeys(found))


def _roads(
    lanes: Sequence[Lane], joints: Sequence[Sequence[tuple[int, int]]]
) -> list[_Road]:
    """Geometry of all roads: what meets has one heading, and one width if it is alone."""
    lines = [_center(lane) for lane in lanes]
    turns: dict[End, float] = {}
    for links in joints:
        ends = _ends(links)
        steps = [np.diff(lines[row][-2 * end :][:2, :2], axis=0) for row, end in ends]
        ways = np.concatenate(steps)
        ways /= np.hypot(*ways.T)[:, None]
        mean = ways.sum(axis=0)
        x, y = mean if np.hypot(*mean) > _STRAIGHT else ways[0]
        turns |= dict.fromkeys(ends, float(np.arctan2(y, x)))
    curves = [
        _pieces(_turned(line[:, :2], turns.get((row, 0)), turns.get((row, 1))))
        for row, line in enumerate(lines)
    ]
    stations = [_stations(pieces) for pieces in curves]
    widths = _widths(lanes, [points for _, points in stations])
    for links in joints:
        if len(links) == 1:
            ((one, other),) = links
            mean = (widths[one][-1] + widths[other][0]) / 2
            widths[one][-1] = widths[other][0] = mean
    roads = []
    for row, (s, _) in enumerate(stations):
        way = arc_length(lines[row][:, :2])
        height = np.interp(s * way[-1] / s[-1], way, lines[row][:, 2])
        roads.append(_Road(curves[row], s, widths[row], height))
    return roads


def _center(lane: Lane) -> Float[np.ndarray, "N 3"]:
    line = without_repeats(lane.centerline[:, :2])
    if len(line) < 2:
        raise ExportError(
            f"Lane {lane.lane_id} has no length; a road of OpenDRIVE needs one."
        )
    kept = shapely.simplify(shapely.LineString(lane.centerline), _SAME_LINE_M)
    return shapely.get_coordinates(kept, include_z=True)


def _turned(
    line: Float[np.ndarray, "N 2"], first: float | None, last: float | None
) -> Float[np.ndarray, "M 2"]:
    """The line with a short way of a given heading at each end that has one."""
    # Twice, since on a single straight the first end's way turns the last end.
    for heading, sign in ((last, -1.0), (first, 1.0)) * 2:
        line = line[::-1]
        if heading is None:
            continue
        step, way = line[1] - line[0], sign * unit_vector(heading)
        aside, ahead = step @ left_of(way), step @ way
        if abs(np.arctan2(aside, ahead)) > _STRAIGHT:
            length = float(np.hypot(*step))
            reach = min(_ASIDE_M * length / max(abs(aside), 1e-9), 0.4 * length, 1.0)
            line = np.vstack([line[:1], line[:1] + reach * way, line[1:]])
    return line


def _pieces(line: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "P 6"]:
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
    used = np.minimum(_CORNER_M / np.tan(half / 2), most) * is_round
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
) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 2"]]:
    """Places along a road, all on straight pieces, and their points."""
    lines = pieces[pieces[:, 5] == 0]
    number = np.ceil(lines[:, 4] / _STATION_M).astype(int) + 1
    share = np.concatenate([np.linspace(0.0, 1.0, one) for one in number.tolist()])
    lines = np.repeat(lines, number, axis=0)
    along = share * lines[:, 4]
    points = lines[:, 1:3] + along[:, None] * unit_vector(lines[:, 3])
    s, kept = np.unique(np.round(lines[:, 0] + along, 9), return_index=True)
    return s, points[kept]


def _widths(
    lanes: Sequence[Lane], places: Sequence[Float[np.ndarray, "_ 2"]]
) -> list[Float[np.ndarray, "_"]]:
    """Widths of lanes at places on their centre lines."""
    number = [len(one) for one in places]
    points = shapely.points(np.concatenate(places))
    sides = ([lane.left_m for lane in lanes], [lane.right_m for lane in lanes])
    both = [
        shapely.distance(points, np.repeat(np.array(lines, object), number))
        for lines in ([shapely.LineString(one) for one in side] for side in sides)
    ]
    width = np.maximum(sum(both), _LEAST_WIDTH_M)
    return np.split(width, np.cumsum(number)[:-1])


def _road(
    root: etree._Element,
    name: tuple[int, int],
    lane: Lane,
    road: _Road,
    links: Sequence[Mapping[str, object] | None],
) -> etree._Element:
    """Add a road; its name is its id and that of its junction."""
    length = road.pieces[-1, 0] + road.pieces[-1, 4]
    found = added(root, "road", name="", length=length, id=name[0], junction=name[1])
    tags = ("predecessor", "successor")
    link = added(found, "link")
    for tag, one in zip(tags, links, strict=True):
        if one is not None:
            added(link, tag, **one)
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
    _profile(places, "laneOffset", road.s_m, road.width_m / 2)
    section = added(places, "laneSection", s=0)
    center = added(added(section, "center"), "lane", id=0, type="none", level="false")
    _mark(center, lane.left_mark)
    right, kind = added(section, "right"), _LANE_TYPES[lane.kind]
    own = added(right, "lane", id=-1, type=kind, level="false")
    link = added(own, "link")
    for tag, one in zip(tags, links, strict=True):
        if one is not None and one["elementType"] == "road":
            added(link, tag, id=-1)
    _profile(own, "width", road.s_m, road.width_m)
    _mark(own, lane.right_mark)
    return found


def _tell(road: etree._Element, lane: Lane) -> None:
    """Add what only this editor reads."""
    own = road.find("lanes/laneSection/right/lane")
    for code, value in (
        (LEFT, lane.left_neighbor),
        (RIGHT, lane.right_neighbor),
        (INTERSECTION, lane.is_intersection or None),
    ):
        if value is not None:
            added(own, "userData", code=code, value=value)


def _profile(
    parent: etree._Element,
    tag: str,
    s_m: Float[np.ndarray, "K"],
    values: Float[np.ndarray, "K"],
) -> None:
    """Linear pieces of values along a road, as few as follow them."""
    name = "sOffset" if tag == "width" else "s"
    line = shapely.LineString(np.column_stack([s_m, values]))
    kept = shapely.get_coordinates(shapely.simplify(line, _SAME_VALUE_M))
    slope = np.diff(kept[:, 1]) / np.diff(kept[:, 0])
    is_new = np.abs(np.diff(slope, prepend=np.inf)) > _SAME_SLOPE
    for (s, a), b in zip(
        kept[:-1][is_new].tolist(), slope[is_new].tolist(), strict=True
    ):
        added(parent, tag, **{name: s}, a=a, b=b, c=0, d=0)


def _mark(lane: etree._Element, mark: LaneMark) -> None:
    if mark in ROAD_MARKS:
        kind, color = ROAD_MARKS[mark]
        added(lane, "roadMark", sOffset=0, type=kind, weight="standard", color=color)


def _connect(
    root: etree._Element,
    lanes: Sequence[Lane],
    roads: Sequence[_Road],
    bridges: Mapping[int, _Road],
    junctions: Sequence[tuple[int, Sequence[tuple[int, int]]]],
    ids: Iterator[int],
) -> None:
    """Add the connecting roads, and after them the junctions."""
    found = []
    for number, links in junctions:
        junction = etree.Element("junction", id=str(number), name="")
        for index, (one, other) in enumerate(links):
            own = next(ids)
            widths = np.array([bridges[one].width_m[0], roads[other].width_m[0]])
            road = replace(bridges[one], width_m=widths)
            ends = _to_road(lanes[one], "end"), _to_road(lanes[other], "start")
            _road(root, (own, number), lanes[one], road, ends)
            way = {"incomingRoad": lanes[one].lane_id, "connectingRoad": own}
            way = added(junction, "connection", id=index, contactPoint="start", **way)
            added(way, "laneLink", **{"from": -1, "to": -1})
        found.append(junction)
    root.extend(found)


def _objects(
    road_map: RoadMap, roads: Sequence[_Road], ids: Iterator[int]
) -> dict[int, etree._Element]:
    """Crosswalks and drivable areas as objects of the nearest road, by its row."""
    paved = {"fillType": PAVING}
    shapes = [("crosswalk", {}, one.outline_m()) for one in road_map.crosswalks]
    shapes += [("none", paved, one.boundary[:, :2]) for one in road_map.drivable_areas]
    tree = shapely.STRtree(
        [shapely.LineString(lane.centerline_m) for lane in road_map.lanes]
    )
    found: dict[int, etree._Element] = {}
    for kind, filling, ring in shapes:
        middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
        row = int(tree.nearest(shapely.Point(middle)))
        lines = roads[row].pieces[roads[row].pieces[:, 5] == 0]
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
        objects = found.setdefault(row, etree.Element("objects"))
        about = {"id": next(ids), "type": kind, "orientation": "none"}
        outlines = added(added(objects, "object", **about, **place, **size), "outlines")
        outline = added(outlines, "outline", id=0, closed="true", **filling)
        for u, v in local.tolist():
            added(outline, "cornerLocal", u=u, v=v, z=0, height=0)
    return found
