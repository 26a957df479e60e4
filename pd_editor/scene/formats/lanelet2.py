"""Lanelet2 maps in OpenStreetMap's XML (.osm)."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.formats.scene_format import SceneFormat
from pd_editor.scene.formats.xml_file import Place, parse_xml
from pd_editor.scene.geometry.map_projection import utm, utm_zone
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.geometry.polyline import midline, resample
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
_SHAPE_POINTS: Final = 9


def read(path: Path) -> Scenario:
    """Read a map as a scene without agents, in its local metres, else in those of UTM.

    Regulatory elements are left out, since scenes have no place for them.

    Raises:
        FormatError: the file is damaged, has no lanelets, or names what it lacks.
    """
    element, data = parse_xml(path, "osm")
    file = _File(Place(path, element))
    courses = [
        course
        for place in file.relations["lanelet"]
        for course in _courses(file, place)
        if course.kind is not None
    ]
    walks = [
        Crosswalk(
            crosswalk_id=number,
            edge1=file.points(left),
            edge2=file.points(right),
        )
        for number, place in enumerate(file.relations["lanelet"], start=1)
        if file.tags(place).get("subtype") == "crosswalk"
        for left, right in [file.bounds(place)]
    ]
    notes = [file.frame]
    if file.relations["regulatory_element"]:
        count = len(file.relations["regulatory_element"])
        notes.append(f"{count} regulatory elements (signs, lights) are left out.")
    return FileScene(
        path=path,
        name=path.stem,
        lanes=_lanes(file, courses),
        crosswalks=tuple(walks),
        more_paved=tuple(file.paved()),
        notes=tuple(notes),
    ).scenario(data)


Bound = tuple[str, int]
"""Id of a way, and 1 or -1 for the direction in which it is followed."""


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
        self.root = root
        self.relations: defaultdict[str, list[Place]] = defaultdict(list)
        for place in self._present("relation"):
            self.relations[self.tags(place).get("type", "")].append(place)
        if not self.relations["lanelet"]:
            raise root.error(
                "has no lanelets; expected relations of type lanelet, which plain "
                "exports of OpenStreetMap lack."
            )
        self.paved_relations = [
            one
            for one in self.relations["multipolygon"]
            if self.tags(one).get("subtype") in _PAVED_AREAS
        ]
        self.ways = {one.attribute("id"): one for one in self._present("way")}
        self._nodes = {one.attribute("id"): one for one in self._present("node")}

    def _present(self, tag: str) -> Iterable[Place]:
        return (
            one
            for one in self.root.children(tag)
            if one.element.get("action") != "delete"
        )

    @staticmethod
    def tags(place: Place) -> dict[str, str]:
        """Values of an element by key."""
        found = place.element.findall("tag")
        return {one.get("k") or "": one.get("v") or "" for one in found}

    def members(self, place: Place, role: str) -> list[str]:
        """Ids of the ways that a relation has in a role.

        Raises:
            FormatError: the file lacks one of them.
        """
        found = [
            one.attribute("ref")
            for one in place.children("member")
            if one.element.get("role") == role and one.element.get("type") == "way"
        ]
        for one in found:
            if one not in self.ways:
                raise place.error(f"names the way {one[:20]}, which the file lacks.")
        return found

    @cached_property
    def nodes_of(self) -> dict[str, tuple[str, ...]]:
        """Ids of the nodes of each way that a lanelet or an area has."""
        found = {}
        for place in (*self.relations["lanelet"], *self.paved_relations):
            for role in ("left", "right", "outer"):
                for way in self.members(place, role):
                    found[way] = self._nodes_of_way(way)
        for way in self.ways:
            if self.tags(self.ways[way]).get("type") in _PAVED_AREAS:
                found[way] = self._nodes_of_way(way)
        return found

    def _nodes_of_way(self, way: str) -> tuple[str, ...]:
        place = self.ways[way]
        found = [one.attribute("ref") for one in place.children("nd")]
        for one in found:
            if one not in self._nodes:
                raise place.error(f"names the node {one[:20]}, which the file lacks.")
        # The same node again and again is one.
        found = [one for n, one in enumerate(found) if n == 0 or one != found[n - 1]]
        if len(found) < 2:
            raise place.error("has fewer than two different nodes.")
        return tuple(found)

    @cached_property
    def _frame(self) -> tuple[str, dict[str, Float[np.ndarray, "3"]]]:
        """What coordinates are, and the place of each node."""
        names = list(
            dict.fromkeys(name for nodes in self.nodes_of.values() for name in nodes)
        )
        places = [self._nodes[name] for name in names]
        tags = [self.tags(place) for place in places]
        if all("local_x" in one and "local_y" in one for one in tags):
            frame = "Coordinates are the file's own (local_x, local_y)."
            table = np.array([self._local(place) for place in places])
        else:
            degrees = np.array([_degrees(place) for place in places])
            zone = utm_zone(float(np.median(degrees[:, 1])))
            frame = f"Coordinates are those of UTM, zone {zone}."
            table = utm(degrees[:, 0], degrees[:, 1], zone)
        if not np.ptp(table, axis=0).max() >= _LEAST_SPAN_M:
            raise self.root.error("spans less than a metre; expected metres.")
        height = [
            _as_number(one.get("ele") or place.element.get("ele"))
            for one, place in zip(tags, places, strict=True)
        ]
        return frame, dict(zip(names, np.column_stack([table, height]), strict=True))

    @property
    def frame(self) -> str:
        """What coordinates are, as a sentence."""
        return self._frame[0]

    @staticmethod
    def _local(place: Place) -> list[float]:
        found = {one.element.get("k"): one for one in place.children("tag")}
        return [found[name].number("v") for name in ("local_x", "local_y")]

    def ids(self, bound: Bound) -> tuple[str, ...]:
        """Ids of the nodes along a bound."""
        way, direction = bound
        return self.nodes_of[way][::direction]

    def points(self, bound: Bound) -> Float[np.ndarray, "N 3"]:
        """Points along a bound.

        Raises:
            FormatError: all of them are one.
        """
        found = np.array([self._frame[1][name] for name in self.ids(bound)])
        moves = np.linalg.norm(np.diff(found[:, :2], axis=0), axis=1) > 1e-6
        found = found[np.append(True, moves)]
        if len(found) < 2:
            raise self.ways[bound[0]].error("has fewer than two different points.")
        return found

    def bounds(self, place: Place) -> tuple[Bound, Bound]:
        """Left and right bound of a lanelet in its direction, as their places tell it.

        Raises:
            FormatError: it has not one way on each side.
        """
        ways = [self.members(place, role) for role in ("left", "right")]
        if any(len(one) != 1 for one in ways):
            raise place.error("needs one way as left bound and one as right bound.")
        (left,), (right,) = ways
        one, two = (self.points((way, 1))[:, :2] for way in (left, right))
        a, b = resample(one, _SHAPE_POINTS), resample(two, _SHAPE_POINTS)
        turn = 1 if _apart(a, b) <= _apart(a, b[::-1]) else -1
        x, y = np.concatenate([one, two[::-turn]]).T
        x, y = x - x[0], y - y[0]
        # Along the left bound, and back along the right one, is clockwise.
        direction = -1 if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0 else 1
        return (left, direction), (right, direction * turn)

    def paved(self) -> Iterable[BaseGeometry]:
        """Shoulders, and areas that are known to be paved."""
        for place in self.relations["lanelet"]:
            if self.tags(place).get("subtype") in _SHOULDERS:
                left, right = map(self.points, self.bounds(place))
                yield valid_area(np.concatenate([left, right[::-1]])[:, :2])
        for place in self.paved_relations:
            ways = self.members(place, "outer")
            yield from shapely.polygonize(
                [shapely.LineString(self.points((way, 1))[:, :2]) for way in ways]
            ).geoms
        for way, place in self.ways.items():
            if self.tags(place).get("type") in _PAVED_AREAS:
                ring = self.points((way, 1))[:, :2]
                if len(ring) > 2:
                    yield valid_area(ring)


def _apart(one: Float[np.ndarray, "N 2"], two: Float[np.ndarray, "N 2"]) -> float:
    return float(np.linalg.norm(one - two, axis=1).sum())


def _degrees(place: Place) -> tuple[float, float]:
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
    tags = file.tags(place)
    left, right = file.bounds(place)
    kind = _kind(tags)
    user = "bicycle" if kind is LaneKind.BIKE else "vehicle"
    found = [_Course(place=place, left=left, right=right, kind=kind, tags=tags)]
    if tags.get(f"one_way:{user}", tags.get("one_way", "yes")) in _NO:
        (one, way), (two, other) = left, right
        found.append(
            _Course(
                place=place, left=(two, -other), right=(one, -way), kind=kind, tags=tags
            )
        )
    return found


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


def _lanes(file: _File, courses: list[_Course]) -> tuple[Lane, ...]:
    """Lanes with neighbours that share a way, and links that share both end nodes."""
    numbers = _numbers(courses)
    ends = [(file.ids(one.left), file.ids(one.right)) for one in courses]
    begins: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    stops: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    for number, (left, right) in zip(numbers, ends, strict=True):
        begins[left[0], right[0]].append(number)
        stops[left[-1], right[-1]].append(number)
    by_left = {one.left: number for one, number in zip(courses, numbers, strict=True)}
    by_right = {one.right: number for one, number in zip(courses, numbers, strict=True)}
    lanes = []
    for one, number, (to_left, to_right) in zip(courses, numbers, ends, strict=True):
        left, right = file.points(one.left), file.points(one.right)
        lanes.append(
            Lane(
                lane_id=number,
                kind=one.kind or LaneKind.VEHICLE,
                is_intersection="turn_direction" in one.tags,
                centerline=_center(left, right),
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
    return tuple(lanes)


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
    row, other = 0, 0
    middles = [left[0] + right[0]]
    while row < len(left) - 1 or other < len(right) - 1:
        step, gap = _nearest_after(left, row, right[other])
        its_step, its_gap = _nearest_after(right, other, left[row])
        row, other = (step, other) if gap <= its_gap else (row, its_step)
        middles.append(left[row] + right[other])
    center = np.array(middles) / 2
    line = shapely.LineString(center[:, :2])
    if any(line.crosses(shapely.LineString(side[:, :2])) for side in (left, right)):
        return midline(left, right)
    return center


def _nearest_after(
    line: Float[np.ndarray, "N 3"], row: int, point: Float[np.ndarray, "3"]
) -> tuple[int, float]:
    """The nearest of the points after a row, and its distance in the plane."""
    if row == len(line) - 1:
        return row, np.inf
    gap = np.hypot(*(line[row + 1 :, :2] - point[:2]).T)
    nearest = int(gap.argmin())
    return row + 1 + nearest, float(gap[nearest])


def _mark(file: _File, bound: Bound) -> LaneMark:
    way, direction = bound
    tags = file.tags(file.ways[way])
    if tags.get("type") not in _LINES:
        return LaneMark.NONE if "type" in tags else LaneMark.UNKNOWN
    parts = tags.get("subtype", "").split("_")[::direction]
    shape = _MARKS.get("_".join(parts))
    color = "YELLOW" if tags.get("color") == "yellow" else "WHITE"
    return LaneMark.UNKNOWN if shape is None else LaneMark(f"{shape}_{color}")


def _recognises(path: Path) -> bool:
    return path.suffix.lower() == ".osm"


LANELET2: Final = SceneFormat(
    name="lanelet2",
    title="Lanelet2",
    endings=(".osm",),
    recognises=_recognises,
    read=read,
)
