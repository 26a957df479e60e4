"""Lanelet2 maps in OpenStreetMap's XML (.osm)."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from pd_editor.base.errors import FormatError
from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.formats.file_signal import FileSignal
from pd_editor.scene.formats.missing_links import with_missing_links
from pd_editor.scene.formats.packed_file import stem_of
from pd_editor.scene.formats.scene_format import SceneFormat, has_root
from pd_editor.scene.formats.xml_file import Place, parse_xml
from pd_editor.scene.geometry.map_projection import utm, utm_zone
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.geometry.polyline import arc_length, midline, ways_of_bounds
from pd_editor.scene.road_map import Crosswalk, Lane, LaneKind, LaneMark
from pd_editor.scene.scenario import Scenario

_PARTICIPANTS: Final = {
    "bus_lane": {"vehicle:bus"},
    "bicycle_lane": {"bicycle"},
    "emergency_lane": {"vehicle:emergency"},
    "crosswalk": {"pedestrian"},
    "walkway": {"pedestrian"},
    "shared_walkway": {"pedestrian"},
    "stairs": {"pedestrian"},
    "road_shoulder": {"pedestrian"},
    "pedestrian_lane": {"pedestrian"},
    "rail": set(),
}
"""Who may use a lanelet of a subtype; those of others are for vehicles."""
_KINDS: Final = (
    ({"vehicle", "vehicle:car", "vehicle:taxi", "vehicle:truck"}, LaneKind.VEHICLE),
    ({"vehicle:bus", "bus"}, LaneKind.BUS),
    ({"bicycle"}, LaneKind.BIKE),
)
"""Kind of a lane by the first row of which anyone may use it."""
_SHOULDERS: Final = frozenset({"emergency_lane", "road_shoulder"})
_PAVED_AREAS: Final = frozenset(
    {"parking", "parking_lot", "freespace", "exit", "intersection_area"}
)
_NO: Final = frozenset({"no", "false", "0"})
_LINES: Final = frozenset({"line_thin", "line_thick"})
_MARKS: Final = {
    "solid": "SOLID",
    "dashed": "DASHED",
    "solid_solid": "DOUBLE_SOLID",
    "dashed_dashed": "DOUBLE_DASH",
    "solid_dashed": "SOLID_DASH",
    "dashed_solid": "DASH_SOLID",
}
_LEAST_SPAN_M: Final = 1.0
_BESIDE_M: Final = 0.1
"""Centre lines may be this far beside a lanelet."""


Bound = tuple[str, int]
"""Id of a way, and 1 or -1 for the direction in which it is followed."""


def read(path: Path) -> Scenario:
    """Read a map as a scene without agents, in its local metres, else in those of UTM.

    Traffic lights have unknown states; other regulatory elements are left out, since scenes
    have no place for them.

    Raises:
        FormatError: the file is damaged, has no lanelets, or names what it lacks.
    """
    root, data = parse_xml(path, "osm")
    file = _File(root)
    courses: list[_Course] = []
    for place in file.lanelets:
        try:
            courses += _courses(file, place)
        except FormatError as error:
            file.faults.append(error)
    if file.faults and not courses:
        raise file.faults[0]
    walks = [one for one in courses if one.tags.get("subtype") == "crosswalk"]
    shoulders = [one for one in courses if one.tags.get("subtype") in _SHOULDERS]
    driven = [one for one in courses if one.kind is not None]
    lanes, told = _lanes(file, driven)
    # Of two-way lanelets, the direction of the file obeys.
    numbers = {
        one.place.attribute("id"): lane.lane_id
        for one, lane in zip(driven[::-1], lanes[::-1], strict=True)
    }
    lanes, linked = with_missing_links(
        lanes, lambda one, other: not (one.successors and other.predecessors)
    )
    notes = [file.frame, *told, *linked]
    if count := len(file.faults):
        what = str(file.faults[0]).removeprefix(f"{path}, ")
        notes.append(f"Damaged lanelets and areas are left out ({count}): {what}")
    if file.num_rules:
        notes.append(f"{file.num_rules} regulatory elements are left out.")
    if file.lights:
        notes.append(f"{len(file.lights)} traffic lights have unknown states.")
    return FileScene(
        path=path,
        name=stem_of(path),
        lanes=lanes,
        signals=tuple(file.signals(numbers)),
        crosswalks=tuple(
            Crosswalk(
                crosswalk_id=number,
                edge1=file.points(one.left),
                edge2=file.points(one.right),
            )
            for number, one in enumerate(walks, start=1)
        ),
        more_paved=[
            *(valid_area(file.outline(one)) for one in shoulders),
            *file.areas(),
        ],
        notes=tuple(notes),
    ).scenario(data)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Course:
    """A lanelet in a direction in which it is driven."""

    place: Place
    left: Bound
    right: Bound
    kind: LaneKind | None
    tags: Mapping[str, str]


class _File:
    """Nodes, ways and relations of a file by their ids."""

    def __init__(self, root: Place) -> None:
        present = {
            tag: [n for n in root.children(tag) if n.get("action") != "delete"]
            for tag in ("node", "way", "relation")
        }
        self._root = root
        self._nodes = {one.attribute("id"): one for one in present["node"]}
        self._ways = {one.attribute("id"): one for one in present["way"]}
        relations: defaultdict[str, list[Place]] = defaultdict(list)
        for one in present["relation"]:
            relations[_tags(one).get("type", "")].append(one)
        rules = relations["regulatory_element"]
        lights = [n for n in rules if _tags(n).get("subtype") == "traffic_light"]
        self.num_rules = len(rules) - len(lights)
        if not relations["lanelet"]:
            raise root.error(
                "has no lanelets; expected relations of type lanelet. Of a street map "
                "of OpenStreetMap, netconvert --osm-files IN.osm -o OUT.net.xml makes a "
                "SUMO network, which can be opened."
            )
        self._nodes_of: dict[str, tuple[str, ...]] = {}
        self.faults: list[FormatError] = []
        """On lanelets and areas that are left out, such as those at the edge of a cut map."""
        sides = ("left", "right", "centerline")
        self.lanelets = [one for one in relations["lanelet"] if self._has(one, sides)]
        self._areas = [
            self._members(one, "outer")
            for one in relations["multipolygon"]
            if _tags(one).get("subtype") in _PAVED_AREAS and self._has(one, ("outer",))
        ]
        self._areas += [
            [name]
            for name, one in self._ways.items()
            if _tags(one).get("type") in _PAVED_AREAS and self._has(one, (), [name])
        ]
        if self.faults and not self.lanelets:
            raise self.faults[0]
        self.lights = {
            n.attribute("id"): self._members(n, "ref_line")
            for n in lights
            if self._has(n, ("ref_line",))
        }
        """Stop lines, which they may lack, of traffic lights."""
        self._points: dict[Bound, Float[np.ndarray, "_ 3"]] = {}

    def _has(
        self, place: Place, roles: Sequence[str], ways: Sequence[str] = ()
    ) -> bool:
        """Whether the file has all ways and nodes of an area, which are known from here on."""
        try:
            ways = ways or [way for n in roles for way in self._members(place, n)]
            self._nodes_of |= {way: self._nodes_of_way(way) for way in ways}
        except FormatError as error:
            self.faults.append(error)
            return False
        return True

    def _members(self, place: Place, role: str) -> list[str]:
        """Ids of the ways that a relation has in a role."""
        found = [
            one.attribute("ref")
            for one in place.children("member")
            if one.get("role") == role and one.get("type") == "way"
        ]
        for one in found:
            if one not in self._ways:
                raise place.error(f"names the way {one[:20]}, which the file lacks.")
        return found

    def _nodes_of_way(self, way: str) -> tuple[str, ...]:
        place = self._ways[way]
        found = tuple(one.attribute("ref") for one in place.children("nd"))
        for one in found:
            if one not in self._nodes:
                raise place.error(f"names the node {one[:20]}, which the file lacks.")
        if len(set(found)) < 2:
            raise place.error("has fewer than two different nodes.")
        return found

    @cached_property
    def _table(self) -> tuple[str, dict[str, int], Float[np.ndarray, "N 3"]]:
        """What coordinates are; rows of nodes, and their places."""
        names = dict.fromkeys(name for one in self._nodes_of.values() for name in one)
        places = [self._nodes[name] for name in names]
        tags = [_tags(place) for place in places]
        if all("local_x" in one and "local_y" in one for one in tags):
            frame = "Coordinates are the file's own (local_x, local_y)."
            table = np.array([_local(place) for place in places])
        else:
            degrees = np.array([_degrees(place) for place in places])
            zone = utm_zone(float(np.median(degrees[:, 1])))
            frame = f"Coordinates are those of UTM, zone {zone}."
            table = utm(degrees[:, 0], degrees[:, 1], zone)
        if not np.ptp(table, axis=0).max() >= _LEAST_SPAN_M:
            raise self._root.error("spans less than a metre; expected metres.")
        height = [
            _as_number(one.get("ele") or place.get("ele"))
            for one, place in zip(tags, places, strict=True)
        ]
        rows = {name: row for row, name in enumerate(names)}
        return frame, rows, np.column_stack([table, height])

    @property
    def frame(self) -> str:
        """What coordinates are, as a sentence."""
        return self._table[0]

    def ids(self, bound: Bound) -> tuple[str, ...]:
        """Ids of the nodes along a bound."""
        return self._nodes_of[bound[0]][:: bound[1]]

    def tags_of_way(self, bound: Bound) -> dict[str, str]:
        """Values of a bound's way by key."""
        return _tags(self._ways[bound[0]])

    def points(self, bound: Bound) -> Float[np.ndarray, "N 3"]:
        """Points along a bound.

        Raises:
            FormatError: all of them are one.
        """
        if bound not in self._points:
            _, rows, table = self._table
            found = table[[rows[name] for name in self.ids(bound)]]
            moves = np.linalg.norm(np.diff(found[:, :2], axis=0), axis=1) > 1e-6
            if not moves.any():
                raise self._ways[bound[0]].error("has only one point.")
            self._points[bound] = found[np.append(True, moves)]
        return self._points[bound]

    def outline(self, course: _Course) -> Float[np.ndarray, "N 2"]:
        """Ring around a lanelet."""
        left, right = self.points(course.left), self.points(course.right)
        return np.concatenate([left, right[::-1]])[:, :2]

    def bounds(self, place: Place) -> tuple[Bound, Bound]:
        """Left and right bound of a lanelet in its direction, as their places tell it.

        Raises:
            FormatError: it has not one way on each side.
        """
        ways = [self._members(place, role) for role in ("left", "right")]
        if any(len(one) != 1 for one in ways) or ways[0] == ways[1]:
            raise place.error("needs one way as left bound and one as right bound.")
        (left,), (right,) = ways
        one, two = (self.points((way, 1))[:, :2] for way in (left, right))
        own, other = ways_of_bounds(one, two)
        return (left, own), (right, other)

    def own_center(self, place: Place) -> Float[np.ndarray, "N 3"] | None:
        """Centre line that the file has of a lanelet, in any direction."""
        ways = self._members(place, "centerline")
        return self.points((ways[0], 1)) if len(ways) == 1 else None

    def signals(self, numbers: Mapping[str, int]) -> Iterator[FileSignal]:
        """Traffic lights with the lanes of the lanelets that obey them."""
        obeying: defaultdict[str, list[int]] = defaultdict(list)
        for place in self.lanelets:
            for one in place.children("member[@role='regulatory_element']"):
                obeying[one.get("ref")] += [numbers.get(place.attribute("id"), 0)]
        for name, ways in self.lights.items():
            stops = [self.points((way, 1))[:, :2].mean(axis=0) for way in ways]
            stop = stops[0] if stops else None
            yield FileSignal(
                signal_id=name, stop_m={lane: stop for lane in obeying[name] if lane}
            )

    def areas(self) -> Iterator[BaseGeometry]:
        """Areas that are known to be paved, beside lanelets."""
        for ways in self._areas:
            lines = [self.points((way, 1))[:, :2] for way in ways]
            if len(lines) == 1 and len(lines[0]) > 2:
                yield valid_area(lines[0])
            else:
                yield from shapely.polygonize(
                    list(map(shapely.LineString, lines))
                ).geoms


def _tags(place: Place) -> dict[str, str]:
    return {one.get("k"): one.get("v") for one in place.children("tag")}


def _local(place: Place) -> list[float]:
    found = {one.get("k"): one for one in place.children("tag")}
    return [found[name].number("v") for name in ("local_x", "local_y")]


def _degrees(place: Place) -> tuple[float, float]:
    if not (place.get("lat") and place.get("lon")):
        raise place.error(
            "has no place; expected lat and lon in degrees, or local_x and local_y of all "
            "nodes in metres."
        )
    lat, lon = place.number("lat"), place.number("lon")
    if abs(lat) > 90 or abs(lon) > 180:
        raise place.error(
            f"lies at {lat:g}, {lon:g}; expected degrees, or metres as local_x and "
            "local_y."
        )
    return lat, lon


def _as_number(text: str | None) -> float:
    try:
        return float(text or 0.0)
    except ValueError:
        return 0.0


def _courses(file: _File, place: Place) -> list[_Course]:
    """The lanelet in each direction in which it is driven."""
    tags, (left, right) = _tags(place), file.bounds(place)
    kind = _kind(tags)
    pairs = [(left, right)]
    user = "bicycle" if kind is LaneKind.BIKE else "vehicle"
    is_one_way = tags.get(f"one_way:{user}", tags.get("one_way", "yes")) not in _NO
    if kind is not None and not is_one_way:
        pairs.append(((right[0], -right[1]), (left[0], -left[1])))
    return [
        _Course(place=place, left=one, right=two, kind=kind, tags=tags)
        for one, two in pairs
    ]


def _kind(tags: Mapping[str, str]) -> LaneKind | None:
    told = {
        name.removeprefix("participant:"): value
        for name, value in tags.items()
        if name.startswith("participant:")
    }
    admitted = _PARTICIPANTS.get(tags.get("subtype", ""), {"vehicle"})
    if told:
        admitted = {name for name, value in told.items() if value not in _NO}
    return next((kind for users, kind in _KINDS if users & admitted), None)


def _lanes(file: _File, courses: list[_Course]) -> tuple[tuple[Lane, ...], list[str]]:
    """Lanes with neighbours that share a way, and links that share both end nodes; notes."""
    numbers = _numbers(courses)
    ends = [(file.ids(one.left), file.ids(one.right)) for one in courses]
    begins: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    stops: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    for number, (left, right) in zip(numbers, ends, strict=True):
        begins[left[0], right[0]].append(number)
        stops[left[-1], right[-1]].append(number)
    by_left = {one.left: number for one, number in zip(courses, numbers, strict=True)}
    by_right = {one.right: number for one, number in zip(courses, numbers, strict=True)}
    lanes, outside = [], 0
    for one, number, (to_left, to_right) in zip(courses, numbers, ends, strict=True):
        left, right = file.points(one.left), file.points(one.right)
        center = middle = _center(left, right)
        if (told := file.own_center(one.place)) is not None:
            center = _within(told, valid_area(file.outline(one)), middle)
            outside += center is middle
        lanes.append(
            Lane(
                lane_id=number,
                kind=one.kind or LaneKind.VEHICLE,
                is_intersection="turn_direction" in one.tags,
                centerline=center,
                left=left,
                right=right,
                left_mark=_mark(file, one.left),
                right_mark=_mark(file, one.right),
                successors=tuple(begins[to_left[-1], to_right[-1]]),
                predecessors=tuple(stops[to_left[0], to_right[0]]),
                left_neighbor=by_right.get(one.left),
                right_neighbor=by_left.get(one.right),
            )
        )
    told = (
        f"Centre lines of {outside} lanelets are not between their bounds and left out."
    )
    return tuple(lanes), [told] if outside else []


def _within(
    told: Float[np.ndarray, "N 3"],
    ground: BaseGeometry,
    middle: Float[np.ndarray, "M 3"],
) -> Float[np.ndarray, "_ 3"]:
    """A lanelet's own centre line if it is one, in the direction of the middle; else that."""
    line = shapely.LineString(told[:, :2])
    is_whole = line.length > arc_length(middle[:, :2])[-1] / 2
    if not (is_whole and ground.buffer(_BESIDE_M).covers(line)):
        return middle
    start, end = np.linalg.norm(told[[0, -1], :2] - middle[0, :2], axis=1)
    return told if start <= end else told[::-1]


def _numbers(courses: list[_Course]) -> list[int]:
    """Ids of lanes: the file's own, and new ones for what has none of its own."""
    own = [one.place.integer("id") for one in courses]
    following = max(0, *own) + 1 if own else 1
    seen: set[int] = set()
    found = []
    for number in own:
        is_free = number > 0 and number not in seen
        found.append(number if is_free else following)
        seen.add(found[-1])
        following += not is_free
    return found


def _center(
    left: Float[np.ndarray, "L 3"], right: Float[np.ndarray, "R 3"]
) -> Float[np.ndarray, "N 3"]:
    """Middles of the shortest connections of both bounds, as Lanelet2 defines the centre."""
    gaps = np.hypot(*(left[:, None, :2] - right[None, :, :2]).T).T
    ends = len(left) - 1, len(right) - 1
    row, other = 0, 0
    pairs = [(0, 0)]
    while (row, other) != ends:
        ahead, its_ahead = gaps[row + 1 :, other], gaps[row, other + 1 :]
        if other == ends[1] or (row < ends[0] and ahead.min() <= its_ahead.min()):
            row += 1 + int(ahead.argmin())
        else:
            other += 1 + int(its_ahead.argmin())
        pairs.append((row, other))
    rows, others = np.array(pairs).T
    center = (left[rows] + right[others]) / 2
    line = shapely.LineString(center[:, :2])
    if any(line.crosses(shapely.LineString(side[:, :2])) for side in (left, right)):
        return midline(left, right)
    return center


def _mark(file: _File, bound: Bound) -> LaneMark:
    tags = file.tags_of_way(bound)
    if tags.get("type") not in _LINES:
        return LaneMark.NONE if "type" in tags else LaneMark.UNKNOWN
    parts = tags.get("subtype", "").split("_")[:: bound[1]]
    shape = _MARKS.get("_".join(parts))
    color = "YELLOW" if tags.get("color") == "yellow" else "WHITE"
    return LaneMark.UNKNOWN if shape is None else LaneMark(f"{shape}_{color}")


LANELET2: Final = SceneFormat(
    name="lanelet2",
    title="Lanelet2",
    endings=(".osm",),
    recognises=has_root("osm", ".osm"),
    read=read,
)
