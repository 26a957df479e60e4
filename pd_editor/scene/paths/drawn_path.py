"""Paths to follow that a user gives: drawn points, or lanes one after another."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.frenet import FrenetFrames, mitred_normals
from pd_editor.scene.geometry.polyline import (
    densify,
    point_at,
    smoothed,
    without_repeats,
)
from pd_editor.scene.paths.driving_paths import (
    SPACING_M,
    DrivingPaths,
    lateral_offsets,
    with_limits,
)
from pd_editor.scene.road_map import RoadMap

_DENSE_M: Final = 0.5
_SMOOTHING_M: Final = 1.5
"""Width of the filter that removes the trembling of a hand."""
_LEAST_LENGTH_M: Final = 1.0
_MOST_TURN_RAD: Final = 1.2
_OVERLAP_M: Final = 1.0
"""Lanes that end closer to the next one's start are joined without a gap."""


def lane_line(
    road_map: RoadMap, lane_ids: Sequence[int]
) -> Float[np.ndarray, "N 2"] | None:
    """Centre lines of lanes one after another; None if a lane is not on the map.

    Beside the lane before, a lane is entered by a lane change.
    """
    line = np.zeros((0, 2))
    for lane_id in lane_ids:
        lane = road_map.lane_of.get(lane_id)
        if lane is None:
            return None
        points = lane.centerline_m
        if len(line):
            gap = np.linalg.norm(points - line[-1], axis=-1)
            first = int(gap.argmin())
            # A parallel lane goes on where the one before ends.
            points = points[first if gap[0] > _OVERLAP_M else 1 :]
        line = np.concatenate([line, points])
    return without_repeats(line)


@dataclass(frozen=True, kw_only=True, eq=False)
class FollowedPath:
    """Path from an agent's pose that joins a line."""

    path: DrivingPaths
    length_m: float
    """Its length up to the line's end."""
    start_m: float
    """Arc length of the line at which the path begins; below 0 before its first point."""
    first_mps: float
    """Speed of the agent where the path begins."""
    turn_rad: float
    """Angle from the line's direction, where the agent joins it, to the heading."""

    @property
    def is_drivable(self) -> bool:
        """Whether the line leads ahead, not sideways or backwards."""
        return self.length_m >= _LEAST_LENGTH_M and abs(self.turn_rad) < _MOST_TURN_RAD


def path_to_follow(
    points_m: Float[np.ndarray, "N 2"],
    position_m: Float[np.ndarray, "2"],
    heading_rad: float,
    speed_mps: float,
) -> FollowedPath:
    """Path from an agent's pose that joins a line.

    The line is joined smoothly, beside the agent or at its start if that is ahead.
    """
    line = densify(without_repeats(np.asarray(points_m, float)), _DENSE_M)
    ahead = line[0] - position_m
    forward = unit_vector(heading_rad)
    start = line[min(1, len(line) - 1)] - line[0]
    is_before = float(ahead @ forward) > 0 and float(ahead @ start) > 0
    before = float(np.linalg.norm(ahead)) if is_before else 0.0
    before = before if before > _DENSE_M else 0.0
    if before:
        line = densify(np.concatenate([position_m[None], line]), _DENSE_M)
    if len(line) > 2:
        middle = smoothed(line, _SMOOTHING_M / _DENSE_M)
        line = np.concatenate([line[:1], middle[1:-1], line[-1:]])
    line = without_repeats(line, 1e-3)
    frame = FrenetFrames(points_m=line[None])
    along, offset = frame.to_frenet(position_m[None, None])
    s, d = max(float(along[0, 0]), 0.0), float(offset[0, 0])
    total = float(frame.along_m[0, -1])
    length = max(total - s, 0.0)
    count = max(int(np.ceil(length / SPACING_M)) + 8, 12)
    grid = s + SPACING_M * np.arange(count)
    base = point_at(line, np.minimum(grid, total))
    end = line[-1] - line[-2]
    end = end / np.linalg.norm(end)
    base = base + np.maximum(grid - total, 0.0)[:, None] * end
    turn = wrap_angle(heading_rad - heading_of(base[1:2] - base[:1]))
    lateral = lateral_offsets(
        np.array([d]), np.zeros(1), turn, np.array([speed_mps]), count
    )
    points = base + lateral[0][:, None] * mitred_normals(base[None])[0]
    points[0] = position_m
    heading = np.array([heading_rad])
    return FollowedPath(
        path=with_limits(points[None, :, 0], points[None, :, 1], heading, heading),
        length_m=length,
        start_m=s - before,
        first_mps=speed_mps,
        turn_rad=float(turn[0]),
    )
