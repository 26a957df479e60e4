"""Bands along many paths at once, fading along their length."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.viewer.meshes.flat_mesh import FlatMesh, Primitive, facing_up

MIN_MOTION_M: Final = 1.0
"""Less motion than this is noise of the recording."""
DOT_M: Final = 0.9
"""Length of the dots of a dotted path, and of the gaps between them."""


def path_ribbons(
    points_m: Float[np.ndarray, "P H 2"],
    is_valid: Bool[np.ndarray, "P H"],
    *,
    color: Float[np.ndarray, "P 3"],
    opacity: Float[np.ndarray, "P H"],
    width_m: Float[np.ndarray, "P H"],
    height_m: Float[np.ndarray, "P"],
) -> Primitive:
    """One transparent mesh of all paths; colours are linear material colours.

    The page draws a transparent mesh triangle after triangle: a later path covers an
    earlier one wholly, at any zoom.
    """
    has_segment = is_valid[:, 1:] & is_valid[:, :-1]
    num_paths, num_points = points_m.shape[:2]
    offset = _normals(points_m, has_segment) * (width_m / 2)[..., None]
    vertices = np.stack([points_m + offset, points_m - offset], axis=2)
    first = 2 * np.arange(num_paths * num_points).reshape(num_paths, num_points)
    near, far = first[:, :-1][has_segment], first[:, 1:][has_segment]
    # Both triangles of a segment are consecutive; otherwise, half of each segment would
    # be covered by paths in between.
    faces = np.stack([near, near + 1, far, far, near + 1, far + 1], axis=-1)
    # In tight curves a path folds over itself; both sides of the fold are drawn.
    mesh = facing_up(
        FlatMesh(points_m=vertices.reshape(-1, 2), faces=faces.reshape(-1, 3))
    )
    return Primitive(
        points_m=mesh.points_m,
        faces=mesh.faces,
        height_m=np.repeat(height_m, 2 * num_points),
        color=(1.0, 1.0, 1.0),
        vertex_opacity=np.repeat(opacity.reshape(-1), 2),
        vertex_color=np.repeat(color, 2 * num_points, axis=0),
    )


def path_heights(base_m: float, rank: np.ndarray) -> Float[np.ndarray, "P"]:
    """Heights of paths by their rank from below; no two ranks share one."""
    # Vertical distance between paths, which prevents flickering.
    return base_m + 5e-4 * rank


def dotted(
    points_m: Float[np.ndarray, "P H 2"], is_valid: Bool[np.ndarray, "P H"]
) -> tuple[Float[np.ndarray, "P K 2"], Bool[np.ndarray, "P K"]]:
    """Paths cut into dots of equal length, as paths of more points.

    Two of three points begin and end a dot; the third is invalid and ends it.
    """
    num_paths = len(points_m)
    if not num_paths:
        return np.zeros((0, 1, 2)), np.zeros((0, 1), bool)
    index = np.arange(points_m.shape[1])
    last = np.maximum.accumulate(np.where(is_valid, index, -1), axis=1)
    start = np.where(is_valid.any(1), is_valid.argmax(1), 0)[:, None]
    held = np.take_along_axis(
        points_m, np.where(last < 0, start, last)[..., None], axis=1
    )
    step = np.linalg.norm(np.diff(held, axis=1), axis=-1)
    length = np.concatenate([np.zeros((num_paths, 1)), step.cumsum(axis=1)], axis=1)
    num_dots = max(int(np.ceil(length[:, -1].max() / (2 * DOT_M))), 1)
    at = (2 * DOT_M * np.arange(num_dots)[:, None] + [0.0, DOT_M, DOT_M]).reshape(-1)
    shape = (num_paths, 3 * num_dots)
    # One interpolation serves all paths: they are put end to end, a gap between them.
    base = (np.arange(num_paths) * (length.max(initial=0.0) + 1.0))[:, None]
    wanted = base + np.minimum(at, length[:, -1:])
    known = (base + length).reshape(-1)
    points = np.stack(
        [
            np.interp(wanted.reshape(-1), known, held[..., axis].reshape(-1))
            for axis in range(2)
        ],
        axis=-1,
    ).reshape(*shape, 2)
    is_end = np.tile([True, True, False], num_dots)
    return points, (at < length[:, -1:] + DOT_M / 2) & is_end


def motion_m(
    points_m: Float[np.ndarray, "P H 2"], is_valid: Bool[np.ndarray, "P H"]
) -> Float[np.ndarray, "P"]:
    """Extent of each path: the diagonal of the box around its averaged points."""
    weight = np.concatenate([np.zeros((len(points_m), 1)), is_valid], axis=1)
    total = np.concatenate(
        [np.zeros((len(points_m), 1, 2)), np.where(is_valid[..., None], points_m, 0.0)],
        axis=1,
    )
    weight, total = weight.cumsum(axis=1), total.cumsum(axis=1)
    # Points over which positions are averaged before motion is measured.
    window = min(5, points_m.shape[1])
    count = weight[:, window:] - weight[:, :-window]
    mean = (total[:, window:] - total[:, :-window]) / np.maximum(count, 1.0)[..., None]
    is_known = (count > 0)[..., None]
    low = np.where(is_known, mean, np.inf).min(axis=1, initial=np.inf)
    high = np.where(is_known, mean, -np.inf).max(axis=1, initial=-np.inf)
    return np.linalg.norm(np.maximum(high - low, 0.0), axis=-1)


def _normals(
    points_m: Float[np.ndarray, "P H 2"], has_segment: Bool[np.ndarray, "P H-1"]
) -> Float[np.ndarray, "P H 2"]:
    """Unit normals at points; without motion the last direction is used."""
    step = np.diff(points_m, axis=1) * has_segment[..., None]
    around = np.zeros_like(points_m)
    around[:, :-1] += step
    around[:, 1:] += step
    norm = np.hypot(around[..., 0], around[..., 1])
    moves = norm > 0.05
    index = np.where(moves, np.arange(points_m.shape[1]), -1)
    last = np.maximum.accumulate(index, axis=1)
    first = np.where(moves.any(1), moves.argmax(1), 0)
    source = np.where(last >= 0, last, first[:, None])
    along = np.take_along_axis(around, source[..., None], axis=1)
    size = np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9)[..., None]
    along = along / size
    return np.stack([-along[..., 1], along[..., 0]], axis=-1)
