"""Drawing of roads: lanes along smooth centre curves, turns, crosswalks, kerbs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.geometry.angles import left_of, unit_vector
from pd_editor.geometry.polyline import arc_length, point_at
from pd_editor.scene.road_map import (
    Crosswalk,
    DrivableArea,
    Lane,
    LaneKind,
    LaneMark,
    RoadMap,
)

POINT_SPACING_M = 3.0
TURN_SPACING_M = 1.2
FIRST_LANE_ID = 1001
Points = Float[np.ndarray, "N 2"]


@dataclass(frozen=True, kw_only=True)
class Street:
    """A centre curve, given by its heading as a function of distance."""

    heading: Callable[[Float[np.ndarray, "N"]], Float[np.ndarray, "N"]]
    origin: tuple[float, float] = (0.0, 0.0)
    """Where distance is zero."""

    def at(
        self, along: Float[np.ndarray, "N"], right: Float[np.ndarray, "N"] | float
    ) -> Points:
        """Points at distances along the curve and to its right."""
        grid = np.arange(-200.0, 200.25, 0.25)
        middle = unit_vector(self.heading((grid[1:] + grid[:-1]) / 2)) * 0.25
        track = np.concatenate([np.zeros((1, 2)), np.cumsum(middle, axis=0)])
        track = track - track[len(grid) // 2] + np.array(self.origin)
        base = np.stack([np.interp(along, grid, track[:, k]) for k in (0, 1)], axis=-1)
        normal = left_of(unit_vector(self.heading(along)))
        return base - np.broadcast_to(right, along.shape)[:, None] * normal


@dataclass(frozen=True, kw_only=True)
class LaneDrawing:
    """A lane before it has an id."""

    name: str
    center: Points
    left: Points
    right: Points
    left_mark: LaneMark = LaneMark.NONE
    right_mark: LaneMark = LaneMark.NONE
    kind: LaneKind = LaneKind.VEHICLE
    is_intersection: bool = False
    successors: tuple[str, ...] = ()
    left_neighbor: str | None = None
    right_neighbor: str | None = None


def lane_along(
    street: Street,
    name: str,
    start: float,
    end: float,
    right: float,
    width: float,
    marks: tuple[LaneMark, LaneMark],
    *,
    shift_from: float | None = None,
    kind: LaneKind = LaneKind.VEHICLE,
    is_intersection: bool = False,
) -> LaneDrawing:
    """A lane from one distance to another, its centre ``right`` of the curve.

    Right is seen in driving direction, which is backwards if ``end`` < ``start``.
    With ``shift_from`` the lane begins there and shifts over in its first 20 m.
    """
    count = max(round(abs(end - start) / POINT_SPACING_M), 4) + 1
    along = np.linspace(start, end, count)
    side = 1.0 if end > start else -1.0
    center = np.full(count, right)
    if shift_from is not None:
        done = np.clip(np.abs(along - start) / 20.0, 0.0, 1.0)
        center = shift_from + (right - shift_from) * done**2 * (3 - 2 * done)
    return LaneDrawing(
        name=name,
        center=street.at(along, side * center),
        left=street.at(along, side * (center - width / 2)),
        right=street.at(along, side * (center + width / 2)),
        left_mark=marks[0],
        right_mark=marks[1],
        kind=kind,
        is_intersection=is_intersection,
    )


def turn_between(first: LaneDrawing, second: LaneDrawing) -> LaneDrawing:
    """A lane inside a junction that joins the end of one lane to the next."""
    lines = [
        _smooth_join(getattr(first, side), getattr(second, side))
        for side in ("center", "left", "right")
    ]
    return LaneDrawing(
        name=f"{first.name}>{second.name}",
        center=lines[0],
        left=lines[1],
        right=lines[2],
        kind=first.kind,
        is_intersection=True,
        successors=(second.name,),
    )


def _smooth_join(before: Points, after: Points) -> Points:
    """A cubic curve with the end directions of both lines."""
    start, end = before[-1], after[0]
    out = before[-1] - before[-2]
    out = out / np.linalg.norm(out)
    into = after[1] - after[0]
    into = into / np.linalg.norm(into)
    # A quarter circle needs 0.55 of the way to the corner, a straight line a third.
    turn = abs(out[0] * into[1] - out[1] * into[0])
    reach = np.linalg.norm(end - start) * (1 / 3 + turn * (0.39 - 1 / 3))
    control = np.stack([start, start + reach * out, end - reach * into, end])
    t = np.linspace(0, 1, 200)[:, None]
    weight = np.concatenate(
        [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1
    )
    fine = weight @ control
    length = arc_length(fine)[-1]
    spacing = POINT_SPACING_M if turn < 0.3 else TURN_SPACING_M
    count = max(int(np.ceil(length / spacing)), 4) + 1
    line = point_at(fine, np.linspace(0, length, count))
    line[0], line[-1] = start, end
    return line


def side_by_side(*lanes: LaneDrawing) -> list[LaneDrawing]:
    """Lanes of one direction, left to right, that know their neighbours."""
    names = [None, *(lane.name for lane in lanes), None]
    return [
        replace(lane, left_neighbor=names[k], right_neighbor=names[k + 2])
        for k, lane in enumerate(lanes)
    ]


def linked(
    lanes: Sequence[LaneDrawing], links: dict[str, tuple[str, ...]]
) -> list[LaneDrawing]:
    """Lanes with more successors."""
    return [
        replace(lane, successors=lane.successors + links.get(lane.name, ()))
        for lane in lanes
    ]


def crosswalk(
    street: Street, at: float, half_width: float, crosswalk_id: int
) -> Crosswalk:
    """A crossing, 3 m deep, over a street."""
    edges = [
        _lifted(street.at(np.full(2, at + depth), np.array([-half_width, half_width])))
        for depth in (-1.5, 1.5)
    ]
    return Crosswalk(crosswalk_id=crosswalk_id, edge1=edges[0], edge2=edges[1])


def band(
    street: Street, start: float, end: float, half_width: float
) -> shapely.Polygon:
    """The area on both sides of a street's centre curve."""
    along = np.linspace(start, end, 61)
    left, right = street.at(along, -half_width), street.at(along, half_width)
    return shapely.Polygon(np.concatenate([left, right[::-1]]))


def paved(
    roads: Sequence[shapely.Polygon],
    parking: Sequence[shapely.Polygon],
    corner_radius: float,
) -> DrivableArea:
    """One paved area; inner corners are rounded, those of parking strips by 2.5 m."""
    rounded = _rounded(shapely.union_all(np.array(roads, object)), corner_radius)
    rounded = _rounded(shapely.union_all(np.array([rounded, *parking], object)), 2.5)
    rounded = shapely.simplify(rounded, 0.03)
    assert isinstance(rounded, shapely.Polygon)
    ring = np.array(rounded.exterior.coords)[:-1]
    return DrivableArea(area_id=1, boundary=_lifted(ring))


def _rounded(area: shapely.Geometry, radius: float) -> shapely.Geometry:
    """An area grown and shrunk again, which fills its inner corners."""
    grown = shapely.buffer(area, radius, quad_segs=24)
    return shapely.buffer(grown, -radius, quad_segs=24)


def road_map(
    lanes: Sequence[LaneDrawing],
    crosswalks: tuple[Crosswalk, ...],
    area: DrivableArea,
) -> RoadMap:
    """The drawing as a map, with ids for names."""
    id_of = {lane.name: FIRST_LANE_ID + k for k, lane in enumerate(lanes)}
    before: dict[str, list[int]] = {lane.name: [] for lane in lanes}
    for lane in lanes:
        for name in lane.successors:
            before[name].append(id_of[lane.name])

    def neighbor(name: str | None) -> int | None:
        return None if name is None else id_of[name]

    return RoadMap(
        lanes=tuple(
            Lane(
                lane_id=id_of[lane.name],
                kind=lane.kind,
                is_intersection=lane.is_intersection,
                centerline=_lifted(lane.center),
                left=_lifted(lane.left),
                right=_lifted(lane.right),
                left_mark=lane.left_mark,
                right_mark=lane.right_mark,
                successors=tuple(id_of[name] for name in lane.successors),
                predecessors=tuple(before[lane.name]),
                left_neighbor=neighbor(lane.left_neighbor),
                right_neighbor=neighbor(lane.right_neighbor),
            )
            for lane in lanes
        ),
        crosswalks=crosswalks,
        drivable_areas=(area,),
    )


def _lifted(points: Points) -> Float[np.ndarray, "N 3"]:
    return np.column_stack([np.round(points, 2), np.zeros(len(points))])
