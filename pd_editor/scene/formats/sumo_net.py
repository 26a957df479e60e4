"""What SUMO net files say of lanes, junctions and footways."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from pd_editor.scene.formats.xml_file import Place, parse_xml
from pd_editor.scene.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.geometry.polyline import arc_length, at_height_zero, offset_line
from pd_editor.scene.road_map import Crosswalk, LaneKind
from pd_editor.scene.scene_limits import MAX_COORDINATE_M

_KIND_OF: Final = {
    "passenger": LaneKind.VEHICLE,
    "bus": LaneKind.BUS,
    "bicycle": LaneKind.BIKE,
    "delivery": LaneKind.VEHICLE,
    "truck": LaneKind.VEHICLE,
}
"""Kind of a lane by the first of these that may use it."""
_CLASSES: Final = frozenset([
    "private", "emergency", "authority", "army", "vip", "pedestrian", "passenger",
    "hov", "taxi", "bus", "coach", "delivery", "truck", "trailer", "motorcycle",
    "moped", "bicycle", "evehicle", "tram", "rail_urban", "rail", "rail_electric",
    "rail_fast", "ship", "container", "cable_car", "subway", "aircraft", "wheelchair",
    "scooter", "drone", "custom1", "custom2",
])  # fmt: skip
"""All classes of vehicles."""
_MOTORISED: Final = "passenger private taxi bus coach delivery truck trailer motorcycle"
ALLOWED_ON: Final = {
    LaneKind.VEHICLE: f"{_MOTORISED} moped bicycle emergency",
    LaneKind.BUS: "bus taxi bicycle emergency",
    LaneKind.BIKE: "bicycle",
}
"""Classes that may use lanes of a kind in networks made here."""
JUNCTION: Final = "junction"
"""Type of edges made here of lanes through junctions."""
CROSSWALK: Final = "crosswalk"
PAVED: Final = "drivable"
"""Types of polygons that are what their names say."""
USUAL_WIDTH_M: Final = 3.2
_MAX_LEGS_OF_PASSAGE: Final = 2
_LEAST_GAP_M: Final = 1.0
"""Between lanes that meet without a lane through the junction."""
_CURVE_POINTS: Final = 9


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoLane:
    """A lane of a SUMO net."""

    sumo_id: str
    edge: str
    index: int
    """Index counted from the kerb."""
    shape_m: Float[np.ndarray, "N 2"]
    width_m: float
    admitted: frozenset[str]
    """Vehicle classes that may use it."""
    length_m: float
    speed_mps: float

    @property
    def is_internal(self) -> bool:
        """Whether it is within a junction."""
        return self.edge.startswith(":")

    @property
    def junction(self) -> str:
        """Junction of an internal lane."""
        return self.edge[1:].rpartition("_")[0]

    @cached_property
    def kind(self) -> LaneKind | None:
        """Kind of the lane; None for sidewalks, rails and parking strips."""
        kinds = (kind for name, kind in _KIND_OF.items() if name in self.admitted)
        return next(kinds, None)

    @property
    def is_parking(self) -> bool:
        """Whether it is a parking strip, which nobody may drive on."""
        return not self.admitted and not self.is_internal

    @property
    def is_sidewalk(self) -> bool:
        """Whether only pedestrians may use the lane."""
        return self.admitted == {"pedestrian"}


@dataclass(frozen=True, kw_only=True)
class Turn:
    """Connection from a lane of an edge to one of the next edge."""

    start: str
    end: str
    """SUMO ids of the lanes."""
    direction: str
    """SUMO's letter: s straight, l and r turns, L and R slight ones, t U-turn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoNet:
    """Contents of a net that a road map needs."""

    lanes: Mapping[str, SumoLane]
    """Lanes by SUMO id, in the order of the file."""
    links: tuple[tuple[str, str], ...]
    """Pairs of consecutive lanes, including internal lanes of junctions."""
    junction_of: Mapping[str, tuple[str, str]]
    """Junctions at the start and end of each normal edge."""
    num_legs: Mapping[str, int]
    """Number of roads at each junction; a road with two directions counts once."""
    junction_areas_m: Mapping[str, Float[np.ndarray, "_ 2"]]
    walking_areas_m: tuple[Float[np.ndarray, "_ 2"], ...]
    crossings: tuple[tuple[Float[np.ndarray, "_ 2"], float], ...]
    """Centre line and width of each pedestrian crossing."""
    has_signals: bool
    turns: tuple[Turn, ...] = ()
    """Connections between lanes of normal edges, junctions left out."""
    drives_left: bool = False
    junction_edges: frozenset[str] = frozenset()
    """Edges that are lanes through a junction by their type: in networks made here."""

    @cached_property
    def lanes_of_edge(self) -> dict[str, list[SumoLane]]:
        """Lanes of each edge, from the kerb to the left."""
        result: dict[str, list[SumoLane]] = {}
        for lane in self.lanes.values():
            result.setdefault(lane.edge, []).append(lane)
        return result

    @property
    def parking_strips_m(self) -> tuple[Float[np.ndarray, "_ 2"], ...]:
        """Centre lines of parking strips."""
        return tuple(lane.shape_m for lane in self.lanes.values() if lane.is_parking)

    @cached_property
    def crossed_junctions(self) -> set[str]:
        """Junctions with crossing connections, not only forks or merges."""
        ways: dict[str, set[tuple[str, str]]] = {}
        for start, end in self.links:
            first = self.lanes[start]
            if first.is_internal:
                continue
            ways.setdefault(self.junction_of[first.edge][1], set()).add(
                (first.edge, end)
            )
        target = {
            a: self.lanes[b].edge for a, b in self.links if self.lanes[a].is_internal
        }
        found = set()
        for junction, pairs in ways.items():
            if self.num_legs[junction] <= _MAX_LEGS_OF_PASSAGE:
                continue
            roads = {(start, self._road_after(via, target)) for start, via in pairs}
            if any(a[0] != b[0] and a[1] != b[1] for a in roads for b in roads):
                found.add(junction)
        return found

    def _road_after(self, via: str, target: Mapping[str, str]) -> str:
        edge, seen = self.lanes[via].edge, set()
        while edge.startswith(":") and edge not in seen:
            seen.add(edge)
            edge = target.get(f"{edge}_{via.rpartition('_')[2]}", edge.lstrip(":"))
        return edge

    def crosswalks(self, first_id: int) -> tuple[Crosswalk, ...]:
        """Pedestrian crossings, numbered from ``first_id``."""
        return tuple(
            Crosswalk(
                crosswalk_id=number,
                edge1=at_height_zero(offset_line(middle[[0, -1]], width / 2)),
                edge2=at_height_zero(offset_line(middle[[0, -1]], -width / 2)),
            )
            for number, (middle, width) in enumerate(self.crossings, start=first_id)
        )

    def paved_beside_lanes(self) -> list[BaseGeometry]:
        """Parking strips and junctions of lanes for vehicles, without sidewalks."""
        ends = {
            end
            for lane in self.lanes.values()
            if lane.kind is not None
            for end in self.junction_of.get(lane.edge, ())
        }
        strips = [
            shapely.LineString(lane.shape_m).buffer(lane.width_m / 2, cap_style="flat")
            for lane in self.lanes.values()
            if lane.is_parking and len(lane.shape_m) > 1
        ]
        junctions, pavements = (
            np.array([valid_area(area) for area in areas if len(area) > 2], object)
            for areas in (
                [n for name, n in self.junction_areas_m.items() if name in ends],
                self.walking_areas_m,
            )
        )
        # A difference of all together would take as long as all else.
        found = shapely.STRtree(pavements).query(junctions, predicate="intersects")
        for row in np.unique(found[0]):
            beside = shapely.union_all(pavements[found[1][found[0] == row]])
            junctions[row] = shapely.difference(junctions[row], beside)
        return [*strips, *junctions]


def heading_of_sumo(angle_deg: Float[np.ndarray, "P"]) -> Float[np.ndarray, "P"]:
    """Convert angles clockwise from north to headings counter-clockwise from +x."""
    return wrap_angle(np.deg2rad(90.0 - angle_deg))


def center_of_front(
    front_m: Float[np.ndarray, "P 2"],
    heading_rad: Float[np.ndarray, "P"],
    length_m: Float[np.ndarray, "P"],
) -> Float[np.ndarray, "P 2"]:
    """Box centres of vehicles, given the centres of their front bumpers."""
    return front_m - length_m[:, None] / 2 * unit_vector(heading_rad)


def read_sumo_net(net_file: Path) -> SumoNet:
    """What a road map needs of the net in a file.

    Raises:
        FormatError: the file is missing or no SUMO net.
    """
    return sumo_net(parse_xml(net_file, "net")[0])


def sumo_net(root: Place) -> SumoNet:
    """What a road map needs of a net, given its root element.

    Raises:
        FormatError: it lacks edges, or is damaged.
    """
    normal, afoot = [], {"walkingarea": [], "crossing": []}
    through: set[str] = set()
    lanes: dict[str, SumoLane] = {}
    for edge in root.children("edge"):
        name, function = edge.attribute("id"), edge.get("function")
        if function in afoot:
            afoot[function].append(edge.child("lane"))
            continue
        if not name.startswith(":"):
            normal.append(edge)
        if edge.get("type") == JUNCTION:
            through.add(name)
        edge.child("lane")
        for index, place in enumerate(edge.children("lane")):
            lane = _lane(place, name, index)
            if lane.sumo_id in lanes:
                raise place.error("comes twice; expected ids that are unique.")
            lanes[lane.sumo_id] = lane
    if not normal:
        raise root.error("has no edges; expected a SUMO net.")
    ends = {
        edge.attribute("id"): (edge.attribute("from"), edge.attribute("to"))
        for edge in normal
    }
    walks = {one.attribute("id") for part in afoot.values() for one in part}
    connections = _bridged(_connections(root, lanes, walks), lanes, ends)
    return SumoNet(
        lanes=lanes,
        links=tuple(
            (start, via if via in lanes else end)
            for start, via, end, _ in connections
            if via in lanes or end in lanes
        ),
        junction_of=ends,
        num_legs=_num_legs(ends),
        junction_areas_m={
            one.attribute("id"): points_of(one)
            for one in root.children("junction")
            if one.get("shape") and one.get("type") != "internal"
        },
        walking_areas_m=tuple(map(points_of, afoot["walkingarea"])),
        crossings=tuple((points_of(one), _width_m(one)) for one in afoot["crossing"]),
        has_signals=bool(root.children("tlLogic")),
        turns=tuple(
            Turn(start=start, end=end, direction=direction)
            for start, _, end, direction in connections
            if end in lanes and not lanes[start].is_internal
        ),
        junction_edges=frozenset(through),
        drives_left=root.get("lefthand") in ("true", "1"),
    )


def points_of(place: Place) -> Float[np.ndarray, "N 2"]:
    """Points of the attribute ``shape``: of a lane its middle line, else an outline.

    Raises:
        FormatError: they are not numbers.
    """
    text = place.attribute("shape")
    try:
        points = [one.split(",") for one in text.split()]
        found = np.array([(float(x), float(y)) for x, y, *_ in points])
    except ValueError as error:
        raise place.error(f"has no points as its shape: {text[:40]!r}.") from error
    if not len(found) or not (np.abs(found) <= MAX_COORDINATE_M).all():
        raise place.error("has no points as its shape.")
    return found


def _lane(place: Place, edge: str, index: int) -> SumoLane:
    allow, barred = place.get("allow"), frozenset(place.get("disallow").split())
    if allow:
        admitted = _CLASSES if allow == "all" else frozenset(allow.split())
    else:
        admitted = frozenset() if "all" in barred else _CLASSES - barred
    return SumoLane(
        sumo_id=place.attribute("id"),
        edge=edge,
        index=index,
        shape_m=points_of(place),
        width_m=_width_m(place),
        admitted=admitted,
        length_m=place.number("length"),
        speed_mps=place.number("speed"),
    )


def _width_m(lane: Place) -> float:
    width = lane.number("width", USUAL_WIDTH_M)
    return width if width > 0 else USUAL_WIDTH_M


Connection = tuple[str, str | None, str, str]
"""Lane, internal lane, next lane and direction."""


def _bridged(
    connections: list[Connection],
    lanes: dict[str, SumoLane],
    ends: Mapping[str, tuple[str, str]],
) -> list[Connection]:
    """Connections; where a net has no lanes in its junctions, they get curves as such."""
    found, inside = [], []
    for row, (start, via, end, direction) in enumerate(connections):
        name = via
        if via not in lanes and end in lanes and not lanes[start].is_internal:
            shape = _curve(lanes[start].shape_m, lanes[end].shape_m)
            if shape is not None:
                edge = f":{ends[lanes[start].edge][1]}_link{row}"
                name = f"{edge}_0"
                length = float(arc_length(shape)[-1])
                lanes[name] = replace(
                    lanes[start], sumo_id=name, edge=edge, index=0, shape_m=shape,
                    length_m=length,
                )  # fmt: skip
                inside.append((name, None, end, direction))
        found.append((start, name, end, direction))
    return [*found, *inside]


def _curve(
    before: Float[np.ndarray, "N 2"], after: Float[np.ndarray, "M 2"]
) -> Float[np.ndarray, "K 2"] | None:
    """Cubic line from the end of a line to the start of another; None where they meet."""
    first, last = before[-1], after[0]
    gap = float(np.hypot(*(last - first)))
    if gap < _LEAST_GAP_M or len(before) < 2 or len(after) < 2:
        return None
    steps = np.stack([before[-1] - before[-2], after[1] - after[0]])
    leaves, arrives = gap * unit_vector(heading_of(steps))
    t = np.linspace(0.0, 1.0, _CURVE_POINTS)[:, None]
    bow = (
        t * (1 - t) * ((1 - t) * (leaves - last + first) - t * (arrives - last + first))
    )
    return first + t * (last - first) + bow


def _connections(
    root: Place, lanes: Mapping[str, SumoLane], walks: Collection[str]
) -> list[Connection]:
    """All connections, of roads first, in the order of lanes."""
    rank = {name: (lane.is_internal, n) for n, (name, lane) in enumerate(lanes.items())}
    found = []
    for one in root.children("connection"):
        start, end = (
            f"{one.attribute(edge)}_{one.attribute(lane)}"
            for edge, lane in (("from", "fromLane"), ("to", "toLane"))
        )
        for name in (start, end):
            if name not in lanes and name not in walks:
                raise one.error(f"names the lane {name[:40]}, which the net lacks.")
        if start in lanes:
            found.append((start, one.element.get("via"), end, one.get("dir", "s")))
    return sorted(found, key=lambda one: rank[one[0]])


def _num_legs(ends: Mapping[str, tuple[str, str]]) -> dict[str, int]:
    others: dict[str, set[str]] = {}
    for start, end in ends.values():
        others.setdefault(start, set()).add(end)
        others.setdefault(end, set()).add(start)
    return {junction: len(there) for junction, there in others.items()}
