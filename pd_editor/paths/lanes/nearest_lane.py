"""Nearest lanes of points."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.angles import unit_vector, wrap_angle
from pd_editor.paths.lanes.lane_graph import LaneGraph, LaneSegments, lane_graph
from pd_editor.scene.road_map import LaneKind, RoadMap

DRIVING_LANES: Final = (LaneKind.VEHICLE, LaneKind.BUS)
WRONG_WAY_M: Final = 5.0
"""Extra distance up to which a lane is preferred to one in the opposite direction."""
_CHUNK: Final = 100_000
"""Pairs of point and segment per chunk; their arrays fit into the cache."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneMatch:
    """Nearest lane of each of N points; fields are 0 where ``is_valid`` is false."""

    lane_id: Int[np.ndarray, "N"]
    distance_m: Float[np.ndarray, "N"]
    """Distance to the centre line."""
    offset_m: Float[np.ndarray, "N"]
    """Signed distance: positive to the left of the lane."""
    along_m: Float[np.ndarray, "N"]
    """Arc length from the lane's start to the foot of the point."""
    heading_rad: Float[np.ndarray, "N"]
    """Direction of the lane there."""
    is_valid: Bool[np.ndarray, "N"]
    """False where the map has no lane of the kinds."""


def nearest_lanes(
    road_map: RoadMap,
    points_m: Float[np.ndarray, "N 2"],
    *,
    heading_rad: Float[np.ndarray, "N"] | None = None,
    kinds: tuple[LaneKind, ...] = DRIVING_LANES,
) -> LaneMatch:
    """Match each point with the nearest centre line.

    Given headings, a lane within 90 degrees of the heading is preferred to one in the
    opposite direction unless it is ``WRONG_WAY_M`` further away.
    """
    graph = lane_graph(road_map)
    segments, usable = graph.segments, graph.allowed(kinds)[graph.segments.lane]
    count = len(points_m)
    if not usable.any():
        return LaneMatch(
            lane_id=np.zeros(count, int),
            distance_m=np.zeros(count),
            offset_m=np.zeros(count),
            along_m=np.zeros(count),
            heading_rad=np.zeros(count),
            is_valid=np.zeros(count, bool),
        )
    chunk = max(1, _CHUNK // len(usable))
    best, every = np.zeros(count, int), np.arange(len(usable))
    for start in range(0, count, chunk):
        part = slice(start, start + chunk)
        cost = np.sqrt(segments.squared_m2(points_m[part, None], every))
        if heading_rad is not None:
            cosine = unit_vector(heading_rad[part]) @ segments.direction.T
            cost = cost + np.where(cosine > 0, 0.0, WRONG_WAY_M)
        best[part] = np.where(usable, cost, np.inf).argmin(1)
    return _match(graph, points_m, best)


@dataclass(frozen=True, kw_only=True, eq=False)
class NearbyLanes:
    """Pairs of a point and a lane within reach, sorted by point, then by distance."""

    point: Int[np.ndarray, "Q"]
    lane: Int[np.ndarray, "Q"]
    """Row of the lane in the lane graph."""
    distance_m: Float[np.ndarray, "Q"]
    offset_m: Float[np.ndarray, "Q"]
    """Offset to the left of the lane."""
    along_m: Float[np.ndarray, "Q"]
    """Arc length of the foot; below 0 or above the lane's length past its ends."""
    turn_rad: Float[np.ndarray, "Q"]
    """Heading at the point minus the lane's direction, in (-pi, pi]."""
    is_beside: Bool[np.ndarray, "Q"]
    """False where the point is before the lane's start or past its end."""


def lanes_near(
    graph: LaneGraph,
    points_m: Float[np.ndarray, "N 2"],
    heading_rad: Float[np.ndarray, "N"],
    *,
    reach_m: float,
    usable: Bool[np.ndarray, "N L"],
) -> NearbyLanes:
    """Find all usable lanes within reach of points and 90 degrees of their headings."""
    segments = graph.segments
    point, segment = _pairs_in_reach(segments, points_m, reach_m, usable)
    start, direction = segments.start_m[segment], segments.direction[segment]
    length = segments.length_m[segment]
    rel = points_m[point] - start
    x = rel[:, 0] * direction[:, 0] + rel[:, 1] * direction[:, 1]
    side = direction[:, 0] * rel[:, 1] - direction[:, 1] * rel[:, 0]
    foot = np.clip(x, 0.0, length)
    distance = np.hypot(x - foot, side)
    facing = unit_vector(heading_rad)[point]
    cosine = facing[:, 0] * direction[:, 0] + facing[:, 1] * direction[:, 1]
    near = np.flatnonzero((distance <= reach_m) & (cosine > 0))
    point, segment, x, side = point[near], segment[near], x[near], side[near]
    length, foot, distance = length[near], foot[near], distance[near]
    lane = segments.lane[segment]
    order = np.lexsort((segment, distance.round(9), lane, point))
    pair = point[order] * len(graph.lane_ids) + lane[order]
    first = order[np.diff(pair, prepend=-1) != 0]
    first = first[np.lexsort((lane[first], distance[first].round(9), point[first]))]
    lane, segment, x = lane[first], segment[first], x[first]
    last = np.append(segments.first_of_lane[1:], len(segments.lane)) - 1
    is_before = (segment == segments.first_of_lane[lane]) & (x < 0)
    is_past = (segment == last[lane]) & (x > length[first])
    is_beside = ~(is_before | is_past)
    return NearbyLanes(
        point=point[first],
        lane=lane,
        distance_m=distance[first],
        offset_m=np.where(
            is_beside, np.copysign(distance[first], side[first]), side[first]
        ),
        along_m=segments.along_m[segment] + np.where(is_beside, foot[first], x),
        turn_rad=wrap_angle(heading_rad[point[first]] - segments.heading_rad[segment]),
        is_beside=is_beside,
    )


def _pairs_in_reach(
    segments: LaneSegments,
    points_m: Float[np.ndarray, "N 2"],
    reach_m: float,
    usable: Bool[np.ndarray, "N L"],
) -> tuple[Int[np.ndarray, "Q"], Int[np.ndarray, "Q"]]:
    """Pairs of a point and a segment that may be within reach."""
    low, high = segments.lane_bounds_m
    inside = usable.copy()
    for axis in (0, 1):
        values = points_m[:, axis, None]
        inside &= values >= low[:, axis] - reach_m
        inside &= values <= high[:, axis] + reach_m
    point, lane = np.nonzero(inside)
    first = segments.first_of_lane
    count = np.diff(np.append(first, len(segments.lane)))[lane]
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    point, segment = np.repeat(point, count), np.repeat(first[lane], count) + within
    x, y, reach = segments.circles_m
    gap_x = points_m[:, 0].take(point) - x.take(segment)
    gap_y = points_m[:, 1].take(point) - y.take(segment)
    far = reach.take(segment) + reach_m
    near = np.flatnonzero(gap_x * gap_x + gap_y * gap_y <= far * far)
    return point[near], segment[near]


def _match(
    graph: LaneGraph, points_m: Float[np.ndarray, "N 2"], segment: np.ndarray
) -> LaneMatch:
    segments = graph.segments
    direction, length = segments.direction[segment], segments.length_m[segment]
    rel = points_m - segments.start_m[segment]
    ahead = np.clip((rel * direction).sum(-1), 0.0, length)
    gap = rel - ahead[:, None] * direction
    distance = np.hypot(gap[:, 0], gap[:, 1])
    side = direction[:, 0] * rel[:, 1] - direction[:, 1] * rel[:, 0]
    return LaneMatch(
        lane_id=np.array(graph.lane_ids, int)[segments.lane[segment]],
        distance_m=distance,
        offset_m=np.copysign(distance, side),
        along_m=segments.along_m[segment] + ahead,
        heading_rad=segments.heading_rad[segment],
        is_valid=np.ones(len(points_m), bool),
    )
