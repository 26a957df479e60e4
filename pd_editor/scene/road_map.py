"""Road maps: lanes, crosswalks, drivable areas."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.geometry.polyline import at_height_zero

_Made = TypeVar("_Made")

DENSE_SPACING_M = 2.0
"""Spacing at which a polyline follows the sharpest allowed curve within 0.1 m."""


class LaneKind(StrEnum):
    """Vehicles that may use a lane; Argoverse 2's ``lane_type``."""

    VEHICLE = "VEHICLE"
    BIKE = "BIKE"
    BUS = "BUS"


class LaneMark(StrEnum):
    """Lane marking of a boundary; Argoverse 2's ``LaneMarkType``."""

    DASH_SOLID_YELLOW = "DASH_SOLID_YELLOW"
    DASH_SOLID_WHITE = "DASH_SOLID_WHITE"
    DASHED_WHITE = "DASHED_WHITE"
    DASHED_YELLOW = "DASHED_YELLOW"
    DOUBLE_SOLID_YELLOW = "DOUBLE_SOLID_YELLOW"
    DOUBLE_SOLID_WHITE = "DOUBLE_SOLID_WHITE"
    DOUBLE_DASH_YELLOW = "DOUBLE_DASH_YELLOW"
    DOUBLE_DASH_WHITE = "DOUBLE_DASH_WHITE"
    SOLID_YELLOW = "SOLID_YELLOW"
    SOLID_WHITE = "SOLID_WHITE"
    SOLID_DASH_WHITE = "SOLID_DASH_WHITE"
    SOLID_DASH_YELLOW = "SOLID_DASH_YELLOW"
    SOLID_BLUE = "SOLID_BLUE"
    NONE = "NONE"
    UNKNOWN = "UNKNOWN"


@dataclass(frozen=True, kw_only=True, eq=False)
class Lane:
    """A lane segment.

    Points are [x, y, z]: scene frame in the plane, z the elevation as the source
    has it. Boundaries run in driving direction. Ids of successors, predecessors and
    neighbours may name lanes that are not in the map.
    """

    lane_id: int
    kind: LaneKind
    is_intersection: bool
    centerline: Float[np.ndarray, "N 3"]
    left: Float[np.ndarray, "L 3"]
    right: Float[np.ndarray, "R 3"]
    left_mark: LaneMark
    right_mark: LaneMark
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left_neighbor: int | None
    right_neighbor: int | None
    source_fields: Mapping[str, Any] = field(default_factory=dict)
    """Unknown fields of the source file, written back unchanged."""

    def __post_init__(self) -> None:
        for points in (self.centerline, self.left, self.right):
            points.flags.writeable = False

    @property
    def centerline_m(self) -> Float[np.ndarray, "N 2"]:
        """Centre line in the plane."""
        return self.centerline[:, :2]

    @property
    def left_m(self) -> Float[np.ndarray, "L 2"]:
        """Left boundary in the plane."""
        return self.left[:, :2]

    @property
    def right_m(self) -> Float[np.ndarray, "R 2"]:
        """Right boundary in the plane."""
        return self.right[:, :2]

    def outline_m(self) -> Float[np.ndarray, "M 2"]:
        """Outline of the lane as an open ring: left boundary, then the right one reversed."""
        return np.concatenate([self.left_m, self.right_m[::-1]])

    def reversed(self) -> "Lane":
        """The lane in the opposite driving direction."""
        return replace(
            self,
            centerline=self.centerline[::-1],
            left=self.right[::-1],
            right=self.left[::-1],
            left_mark=self.right_mark,
            right_mark=self.left_mark,
            successors=self.predecessors,
            predecessors=self.successors,
            left_neighbor=self.right_neighbor,
            right_neighbor=self.left_neighbor,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Crosswalk:
    """A pedestrian crossing between two edges, points [x, y, z]."""

    crosswalk_id: int
    edge1: Float[np.ndarray, "N 3"]
    edge2: Float[np.ndarray, "M 3"]
    source_fields: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.edge1.flags.writeable = False
        self.edge2.flags.writeable = False

    def outline_m(self) -> Float[np.ndarray, "K 2"]:
        """Outline of the crosswalk as an open ring, with straight ends."""
        one, two = self.edge1[:, :2], self.edge2[:, :2]
        crossed = np.linalg.norm(one[-1] - two[-1]) > np.linalg.norm(one[-1] - two[0])
        return np.concatenate([one, two if crossed else two[::-1]])


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivableArea:
    """A drivable area, bounded by a ring of points [x, y, z]."""

    area_id: int
    boundary: Float[np.ndarray, "N 3"]
    source_fields: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.boundary.flags.writeable = False


def areas_of(
    rings: Iterable[Float[np.ndarray, "_ 2"]], first_id: int
) -> tuple[DrivableArea, ...]:
    """Drivable areas inside open rings, numbered from ``first_id``."""
    return tuple(
        DrivableArea(area_id=number, boundary=at_height_zero(ring))
        for number, ring in enumerate(rings, start=first_id)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadMap:
    """All lanes, crosswalks and drivable areas of a scenario."""

    lanes: tuple[Lane, ...]
    crosswalks: tuple[Crosswalk, ...] = ()
    drivable_areas: tuple[DrivableArea, ...] = ()
    source_fields: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def lane_of(self) -> dict[int, Lane]:
        """Lane of each lane id."""
        return {lane.lane_id: lane for lane in self.lanes}

    @cached_property
    def oncoming(self) -> frozenset[tuple[int, int]]:
        """Ids of lanes and of neighbours of theirs that lead the other way."""
        way = {
            number: one.centerline_m[-1] - one.centerline_m[0]
            for number, one in self.lane_of.items()
        }
        return frozenset(
            (one.lane_id, number)
            for one in self.lanes
            for number in (one.left_neighbor, one.right_neighbor)
            if number in way and way[one.lane_id] @ way[number] < 0
        )

    @cached_property
    def lane_groups(self) -> tuple[tuple[int, ...], ...]:
        """Ids of adjacent lanes in one direction, each group from right to left."""
        left_of = {
            one.lane_id: other.lane_id
            for one in self.lanes
            if (other := self.lane_of.get(one.left_neighbor or 0)) is not None
            and other.right_neighbor == one.lane_id
        }
        beside = set(left_of.values())
        rest = [one.lane_id for one in self.lanes if one.lane_id not in beside]
        groups: list[tuple[int, ...]] = []
        taken: set[int] = set()
        for first in (*rest, *self.lane_of):
            group: list[int] = []
            one: int | None = first
            while one is not None and one not in taken:
                taken.add(one)
                group.append(one)
                one = left_of.get(one)
            if group:
                groups.append(tuple(group))
        return tuple(groups)

    @cached_property
    def polylines(self) -> tuple[Float[np.ndarray, "_ 3"], ...]:
        """All polylines of the map, in the order of ``with_polylines``."""
        lines: list[np.ndarray] = []
        for lane in self.lanes:
            lines += (lane.centerline, lane.left, lane.right)
        for crosswalk in self.crosswalks:
            lines += (crosswalk.edge1, crosswalk.edge2)
        lines += [area.boundary for area in self.drivable_areas]
        return tuple(lines)

    @cached_property
    def bounds_m(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """Least and largest coordinates of all lines in the plane."""
        points = np.concatenate(self.polylines)[:, :2]
        return points.min(axis=0), points.max(axis=0)

    def with_polylines(self, lines: tuple[Float[np.ndarray, "_ 3"], ...]) -> "RoadMap":
        """Replace the geometry of the map; inverse of ``polylines``."""
        take = iter(lines)
        return RoadMap(
            lanes=tuple(
                replace(lane, centerline=next(take), left=next(take), right=next(take))
                for lane in self.lanes
            ),
            crosswalks=tuple(
                replace(crosswalk, edge1=next(take), edge2=next(take))
                for crosswalk in self.crosswalks
            ),
            drivable_areas=tuple(
                replace(area, boundary=next(take)) for area in self.drivable_areas
            ),
            source_fields=self.source_fields,
        )

    @cached_property
    def reversed(self) -> "RoadMap":
        """The map with all lanes in the opposite direction, to follow them backwards."""
        return replace(self, lanes=tuple(lane.reversed() for lane in self.lanes))

    @cached_property
    def dense(self) -> "RoadMap":
        """Densify all lines to a spacing of at most ``DENSE_SPACING_M``.

        A warp moves points only, so lines need enough of them.
        """
        num_open = len(self.polylines) - len(self.drivable_areas)
        rings = [np.concatenate([ring, ring[:1]]) for ring in self.polylines[num_open:]]
        lines = Lines.of([*self.polylines[:num_open], *rings])
        lines = lines.densified(DENSE_SPACING_M).apart()
        lines[num_open:] = [ring[:-1] for ring in lines[num_open:]]
        return self.with_polylines(tuple(lines))

    def moved(
        self, motion: Callable[[Float[np.ndarray, "P 2"]], Float[np.ndarray, "P 2"]]
    ) -> "RoadMap":
        """Apply a motion of the plane to the map; elevations stay."""
        lines = Lines.of(self.polylines)
        points, z = lines.points_m[:, :2], lines.points_m[:, 2]
        moved = replace(lines, points_m=np.column_stack([motion(points), z]))
        return self.with_polylines(tuple(moved.apart()))


def once_per_map(make: Callable[[RoadMap], _Made]) -> Callable[[RoadMap], _Made]:
    """Let a function be called once for each map; its result lives as long as the map."""
    made: WeakKeyDictionary[RoadMap, _Made] = WeakKeyDictionary()

    @wraps(make)
    def kept(road_map: RoadMap) -> _Made:
        if road_map not in made:
            made[road_map] = make(road_map)
        return made[road_map]

    return kept
