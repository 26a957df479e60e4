"""Frenet frames: coordinates (s, d) along and to the left of polylines.

Between two vertices the normal is interpolated between mitred vertex normals. So
lines of constant d are parallel to the polyline, the frame has no gaps or jumps at
corners, and both directions have a closed form.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import left_of

_MIN_MITRE: Final = 0.5
"""Least cos^2 of half a corner's angle; sharper corners get a cut mitre."""


def mitred_normals(
    points_m: Float[np.ndarray, "*lines P 2"],
) -> Float[np.ndarray, "*lines P 2"]:
    """Left normals at vertices, so long that offset lines stay parallel.

    A line may end in repeats of its last point (padding).
    """
    dx, dy = np.diff(points_m[..., 0]), np.diff(points_m[..., 1])
    inverse = 1 / np.maximum(np.sqrt(dx * dx + dy * dy), 1e-12)
    x, y = -dy * inverse, dx * inverse
    both_x, both_y = x[..., :-1] + x[..., 1:], y[..., :-1] + y[..., 1:]
    # With padding on one side the sum is the other side's normal, which is right.
    scale = 2 / np.maximum(both_x**2 + both_y**2, 4 * _MIN_MITRE)
    normals = np.empty(points_m.shape)
    normals[..., 0, 0], normals[..., 0, 1] = x[..., 0], y[..., 0]
    normals[..., -1, 0], normals[..., -1, 1] = x[..., -1], y[..., -1]
    normals[..., 1:-1, 0] = both_x * scale
    normals[..., 1:-1, 1] = both_y * scale
    return normals


@dataclass(frozen=True, kw_only=True, eq=False)
class FrenetFrames:
    """Frames of R polylines with P >= 2 vertices each.

    Shorter lines are padded by repeating their last vertex; no other vertex may
    repeat the one before. Beyond both ends lines go straight on.
    """

    points_m: Float[np.ndarray, "R P 2"]

    @cached_property
    def along_m(self) -> Float[np.ndarray, "R P"]:
        """Arc length at each vertex."""
        return np.concatenate(
            [np.zeros((len(self.points_m), 1)), np.cumsum(self._length, axis=1)], axis=1
        )

    @cached_property
    def normals(self) -> Float[np.ndarray, "R P 2"]:
        """Mitred left normals at the vertices."""
        return mitred_normals(self.points_m)

    @cached_property
    def _length(self) -> Float[np.ndarray, "R S"]:
        step = np.diff(self.points_m, axis=1)
        return np.hypot(step[..., 0], step[..., 1])

    @cached_property
    def _direction(self) -> Float[np.ndarray, "R S 2"]:
        return (
            np.diff(self.points_m, axis=1) / np.maximum(self._length, 1e-12)[..., None]
        )

    @cached_property
    def _last_segment(self) -> np.ndarray:
        return np.maximum((self._length > 0).sum(1) - 1, 0)

    def to_frenet(
        self, points_m: Float[np.ndarray, "R N 2"]
    ) -> tuple[Float[np.ndarray, "R N"], Float[np.ndarray, "R N"]]:
        """Arc length s and left offset d of points, N per line.

        Of several solutions the one nearest to the line is taken.
        """
        rows = np.arange(len(points_m))[:, None]
        start, direction, length = self.points_m[:, :-1], self._direction, self._length
        tangent_part = (self.normals[:, :-1] * direction).sum(-1)
        turn_part = (self.normals[:, 1:] * direction).sum(-1) - tangent_part
        rel = points_m[:, :, None] - start[:, None]
        x = (rel * direction[:, None]).sum(-1)
        d = (rel * left_of(direction)[:, None]).sum(-1)
        width = length[:, None] + d * turn_part[:, None]
        fraction = (x - d * tangent_part[:, None]) / np.where(width > 0, width, 1.0)
        outside = np.maximum(np.maximum(-fraction, fraction - 1), 0.0)
        segment = np.arange(length.shape[1])
        outside[:, :, 0] = np.maximum(fraction[:, :, 0] - 1, 0)
        last = self._last_segment
        beyond_end = np.where(last > 0, -fraction[rows[:, 0], :, last].T, -np.inf).T
        outside[rows[:, 0], :, last] = np.maximum(beyond_end, 0)
        # A vertex shared by two segments may fall between them by rounding only.
        cost = np.abs(d) + np.where(outside > 1e-9, 1e6 * (1 + outside), 0.0)
        cost = np.where((width > 0) & (segment <= last[:, None, None]), cost, np.inf)
        best = cost.argmin(-1)
        pick = (rows, np.arange(points_m.shape[1])[None], best)
        along = np.clip(fraction[pick], 0, 1) * length[rows, best]
        along = np.where((best == 0) & (x[pick] < 0), x[pick], along)
        at_end = (best == last[:, None]) & (x[pick] > length[rows, best])
        along = np.where(at_end, x[pick], along)
        return self.along_m[rows, best] + along, d[pick]

    def to_plane(
        self, s_m: Float[np.ndarray, "R N"], d_m: Float[np.ndarray, "R N"]
    ) -> Float[np.ndarray, "R N 2"]:
        """Points at arc length s and left offset d, N per line."""
        rows = np.arange(len(s_m))[:, None]
        segment = (s_m[:, :, None] >= self.along_m[:, None, 1:]).sum(-1)
        segment = np.minimum(segment, self._last_segment[:, None])
        length = np.maximum(self._length[rows, segment], 1e-12)
        fraction = (s_m - self.along_m[rows, segment]) / length
        inside = np.clip(fraction, 0, 1)[..., None]
        first, second = self.normals[rows, segment], self.normals[rows, segment + 1]
        normal = first + inside * (second - first)
        start = self.points_m[rows, segment]
        ahead = (fraction * length)[..., None] * self._direction[rows, segment]
        return start + ahead + d_m[..., None] * normal
