"""Where paths cross a stop line, and where the front of an agent is then."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.polyline import point_at
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES, nearest_lanes
from pd_editor.scene.road_map import LaneKind, RoadMap

REACH_M: Final = 8.0
"""Largest distance to a boundary; beyond it a lane has its usual width."""
USUAL_HALF_WIDTH_M: Final = 1.75

LINE_MARGIN_M: Final = 2.0
"""A stop line also counts this far beside its ends."""


def cross_line(
    road_map: RoadMap,
    point_m: Float[np.ndarray, "2"],
    *,
    kinds: tuple[LaneKind, ...] = DRIVING_LANES,
    max_distance_m: float = np.inf,
) -> tuple[Float[np.ndarray, "2 2"], int] | None:
    """Line from the left to the right boundary of the lane nearest to a point.

    It crosses the centre line at a right angle, at the foot of the point. Returns the
    line and the lane's id; None without a lane within ``max_distance_m`` of the point.
    """
    match = nearest_lanes(road_map, point_m[None], kinds=kinds)
    if not match.is_valid[0] or match.distance_m[0] > max_distance_m:
        return None
    lane = road_map.lane_of[int(match.lane_id[0])]
    (left,) = left_of(unit_vector(match.heading_rad[:1]))
    (foot,) = point_at(lane.centerline_m, match.along_m[:1])
    ends = [
        foot + side * _reach(boundary, foot, side * left) * left
        for boundary, side in ((lane.left_m, 1.0), (lane.right_m, -1.0))
    ]
    return np.array(ends), lane.lane_id


def _reach(
    boundary_m: Float[np.ndarray, "N 2"],
    foot_m: Float[np.ndarray, "2"],
    across: Float[np.ndarray, "2"],
) -> float:
    """Distance from a foot to where a boundary is crossed in a direction."""
    rel = boundary_m - foot_m
    aside = rel @ across
    ahead = rel @ np.array([across[1], -across[0]])
    crosses = (ahead[:-1] <= 0) != (ahead[1:] <= 0)
    if not crosses.any():
        return USUAL_HALF_WIDTH_M
    share = ahead[:-1][crosses] / (ahead[:-1][crosses] - ahead[1:][crosses])
    reach = aside[:-1][crosses] + share * (aside[1:] - aside[:-1])[crosses]
    within = reach[(reach > 0) & (reach <= REACH_M)]
    return float(within.min()) if len(within) else USUAL_HALF_WIDTH_M


def crossing(
    path_m: Float[np.ndarray, "N 2"], line_m: Float[np.ndarray, "2 2"]
) -> tuple[int, float] | None:
    """First crossing: index of the point before it, and the share of the way to the next."""
    side, place, length = _line_frame(path_m, line_m)
    near = (place > -LINE_MARGIN_M) & (place < length + LINE_MARGIN_M)
    crosses = (side[:-1] * side[1:] <= 0) & (near[:-1] | near[1:])
    crosses &= side[:-1] != side[1:]
    if not crosses.any():
        return None
    index = int(crosses.argmax())
    share = side[index] / (side[index] - side[index + 1])
    return index, float(share)


def overrun_m(
    position_m: Float[np.ndarray, "N 2"],
    heading_rad: Float[np.ndarray, "N"],
    size_m: Float[np.ndarray, "2"],
    line_m: Float[np.ndarray, "2 2"],
) -> float:
    """How far an agent's front gets beyond a line, seen from where it starts.

    Negative: the least distance before the line. Beside the line: minus infinity.
    """
    forward = unit_vector(heading_rad)
    left = left_of(forward)
    start, _, _ = _line_frame(position_m[:1], line_m)
    worst = -np.inf
    for sign in (-1.0, 0.0, 1.0):
        corner = position_m + size_m[0] / 2 * forward + sign * size_m[1] / 2 * left
        side, place, length = _line_frame(corner, line_m)
        near = (place > -LINE_MARGIN_M) & (place < length + LINE_MARGIN_M)
        beyond = -side * np.sign(start[0])
        worst = max(worst, float(beyond[near].max(initial=-np.inf)))
    return worst


def _line_frame(
    points_m: Float[np.ndarray, "N 2"], line_m: Float[np.ndarray, "2 2"]
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"], float]:
    """Signed distance to a line, place along it, and its length."""
    across = line_m[1] - line_m[0]
    length = float(np.hypot(*across))
    across = across / length
    gap = points_m - line_m[0]
    return gap @ left_of(across), gap @ across, length
