"""Polylines as arrays of points, shape [N 2], in metres."""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.scene.geometry.lines import Lines

MIN_MIDLINE_POINTS: Final = 10
_SHAPE_POINTS: Final = 9


def arc_length(points_m: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N"]:
    """Distance along the line from its first point to each of its points."""
    step = np.linalg.norm(np.diff(points_m, axis=0), axis=-1)
    return np.concatenate([[0.0], np.cumsum(step)])


def without_repeats(
    points_m: Float[np.ndarray, "N D"], tolerance_m: float = 1e-6
) -> Float[np.ndarray, "M D"]:
    """Remove points that repeat the previous one's x and y; at least one remains."""
    step = np.linalg.norm(np.diff(points_m[:, :2], axis=0), axis=-1)
    return points_m[np.concatenate([[True], step > tolerance_m])]


def turns_back(points_m: Float[np.ndarray, "N D"]) -> Int[np.ndarray, "T"]:
    """Points at which a line without repeats turns by more than 120 degrees."""
    step = np.diff(points_m[:, :2], axis=0)
    way = step / np.linalg.norm(step, axis=1, keepdims=True)
    return 1 + np.flatnonzero((way[1:] * way[:-1]).sum(axis=1) < -0.5)


def onward(points_m: Float[np.ndarray, "N D"]) -> Float[np.ndarray, "M D"]:
    """The line without points at which it turns back, the farthest ones first."""
    points_m = without_repeats(points_m)
    while len(turns := turns_back(points_m)):
        gap = np.linalg.norm(points_m[turns + 1, :2] - points_m[turns - 1, :2], axis=1)
        along = arc_length(points_m[:, :2])
        detour = along[turns + 1] - along[turns - 1] - gap
        kept = np.delete(points_m, turns[detour.argmax()], axis=0)
        points_m = without_repeats(kept)
    return points_m


def point_at(
    points_m: Float[np.ndarray, "N 2"],
    distance_m: float | Float[np.ndarray, "*shape"],
) -> Float[np.ndarray, "*shape 2"]:
    """Points at distances along the line; clamped to its two ends."""
    along = arc_length(points_m)
    return np.stack(
        [np.interp(distance_m, along, points_m[:, axis]) for axis in (0, 1)], axis=-1
    )


def resample(
    points_m: Float[np.ndarray, "N 2"], num_points: int
) -> Float[np.ndarray, "num_points 2"]:
    """Resample the line to ``num_points`` points equally spaced along it."""
    length = arc_length(points_m)[-1]
    return point_at(points_m, np.linspace(0.0, length, num_points))


def densify(
    points: Float[np.ndarray, "N D"], max_spacing_m: float
) -> Float[np.ndarray, "M D"]:
    """Add points so that neighbours are at most ``max_spacing_m`` apart.

    All given points are kept exactly. Distances are measured in the first two
    coordinates; further ones (elevation) are interpolated.
    """
    return Lines.of([points]).densified(max_spacing_m).points_m


def smoothed(
    points: Float[np.ndarray, "N D"], width_points: float
) -> Float[np.ndarray, "N D"]:
    """Smooth the line with a Gaussian of that width; its end values are repeated."""
    reach = int(np.ceil(4.0 * width_points))
    kernel = np.exp(
        -0.5 * (np.arange(-reach, reach + 1) / max(width_points, 1e-9)) ** 2
    )
    longer = np.pad(points, ((reach, reach), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(longer, len(kernel), axis=0)
    return windows @ (kernel / kernel.sum())


def offset_line(
    points_m: Float[np.ndarray, "N 2"], distance_m: float
) -> Float[np.ndarray, "N 2"]:
    """Offset the line to its left by a distance, with mitred corners.

    The mitre is limited to twice the distance, so that sharp corners have no spikes.
    """
    return Lines.of([points_m]).offset(distance_m).points_m


def midline(
    left: Float[np.ndarray, "L 3"], right: Float[np.ndarray, "R 3"]
) -> Float[np.ndarray, "N 3"]:
    """Line midway between two boundaries, with at least ten points."""
    num_points = max(MIN_MIDLINE_POINTS, len(left), len(right))
    fraction = np.linspace(0.0, 1.0, num_points)
    resampled = []
    for boundary in (left, right):
        along = arc_length(boundary[:, :2])
        columns = [
            np.interp(fraction * along[-1], along, boundary[:, axis])
            for axis in range(3)
        ]
        resampled.append(np.stack(columns, axis=-1))
    return (resampled[0] + resampled[1]) / 2


def ways_of_bounds(
    left_m: Float[np.ndarray, "L 2"], right_m: Float[np.ndarray, "R 2"]
) -> tuple[int, int]:
    """Ways, 1 or -1, in which two lines are the left and the right bound of a lane."""
    a, b = resample(left_m, _SHAPE_POINTS), resample(right_m, _SHAPE_POINTS)
    apart = [np.linalg.norm(a - other, axis=1).sum() for other in (b, b[::-1])]
    # The inner bound of a U-turn is short, and may lead back.
    shortest = min(np.linalg.norm(one[-1] - one[0]) for one in (a, b))
    is_turned = apart[1] < apart[0] and shortest > 0.5 * apart[1] / _SHAPE_POINTS
    turn = -1 if is_turned else 1
    x, y = (np.concatenate([left_m, right_m[::-turn]]) - left_m[0]).T
    # Along the left bound, and back along the right one, is clockwise.
    way = -1 if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0 else 1
    return way, way * turn


def at_height_zero(points_m: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 3"]:
    """Points of the plane with an elevation of 0."""
    return np.column_stack([points_m, np.zeros(len(points_m))])
