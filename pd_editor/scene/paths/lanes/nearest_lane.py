"""Nearest lanes of points."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.road_map import LaneKind, RoadMap

DRIVING_LANES: Final = (LaneKind.VEHICLE, LaneKind.BUS)


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

    Headings are used as in ``LaneSearch.nearest``.
    """
    graph, count = lane_graph(road_map), len(points_m)
    search, usable = graph.search, graph.allowed(kinds)
    if not usable.any():
        return LaneMatch(
            lane_id=np.zeros(count, int),
            distance_m=np.zeros(count),
            offset_m=np.zeros(count),
            along_m=np.zeros(count),
            heading_rad=np.zeros(count),
            is_valid=np.zeros(count, bool),
        )
    lanes = np.broadcast_to(usable, (count, len(usable)))
    _, segment = search.nearest(points_m, lanes, heading_rad)
    direction, length = search.direction[segment], search.length_m[segment]
    rel = points_m - search.start_m[segment]
    ahead = np.clip((rel * direction).sum(-1), 0.0, length)
    gap = rel - ahead[:, None] * direction
    distance = np.hypot(gap[:, 0], gap[:, 1])
    side = direction[:, 0] * rel[:, 1] - direction[:, 1] * rel[:, 0]
    return LaneMatch(
        lane_id=np.array(graph.lane_ids, int)[search.lane[segment]],
        distance_m=distance,
        offset_m=np.copysign(distance, side),
        along_m=search.along_m[segment] + ahead,
        heading_rad=search.heading_rad[segment],
        is_valid=np.ones(count, bool),
    )
