"""Bands along many paths at once, fading along their length."""

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.viewer.meshes.flat_mesh import FlatMesh, Primitive, facing_up

PATH_HEIGHT_STEP_M = 2e-4
MIN_EXTENT_M = 2.0
"""Paths that stay in a smaller box are not drawn: a standing agent's track jitters."""


def path_ribbons(
    points_m: Float[np.ndarray, "P H 2"],
    is_valid: Bool[np.ndarray, "P H"],
    *,
    color: Float[np.ndarray, "P 3"],
    opacity: Float[np.ndarray, "P H"],
    width_m: Float[np.ndarray, "P H"],
    height_m: float,
) -> Primitive:
    """One transparent mesh of all paths; colours are linear material colours.

    Each path lies a little higher than the one before, so that they cross cleanly.
    """
    both = is_valid[:, 1:] & is_valid[:, :-1]
    kept = _extent(points_m, is_valid) >= MIN_EXTENT_M
    points, both, opacity = points_m[kept], both[kept], opacity[kept]
    width, color = width_m[kept], color[kept]
    num_paths, num_points = points.shape[:2]
    normal = _normals(points, both)
    offset = normal * (width / 2)[..., None]
    vertices = np.stack([points + offset, points - offset], axis=2)
    first = 2 * np.arange(num_paths * num_points).reshape(num_paths, num_points)
    near, far = first[:, :-1][both], first[:, 1:][both]
    faces = np.concatenate(
        [
            np.stack([near, near + 1, far], axis=-1),
            np.stack([far, near + 1, far + 1], axis=-1),
        ]
    )
    # In tight curves a path folds over itself; both sides of the fold are drawn.
    mesh = facing_up(FlatMesh(points_m=vertices.reshape(-1, 2), faces=faces))
    return Primitive(
        points_m=mesh.points_m,
        faces=mesh.faces,
        height_m=height_m
        + PATH_HEIGHT_STEP_M * np.repeat(np.arange(num_paths), 2 * num_points),
        color=(1.0, 1.0, 1.0),
        vertex_opacity=np.repeat(opacity.reshape(-1), 2),
        vertex_color=np.repeat(
            np.broadcast_to(color[:, None], (num_paths, num_points, 3)).reshape(-1, 3),
            2,
            axis=0,
        ),
    )


def _extent(
    points_m: Float[np.ndarray, "P H 2"], is_valid: Bool[np.ndarray, "P H"]
) -> Float[np.ndarray, "P"]:
    """Diagonal of the box around each path's valid points."""
    valid = is_valid[..., None]
    low = np.where(valid, points_m, np.inf).min(axis=1, initial=np.inf)
    high = np.where(valid, points_m, -np.inf).max(axis=1, initial=-np.inf)
    return np.linalg.norm(np.maximum(high - low, 0.0), axis=-1)


def _normals(
    points_m: Float[np.ndarray, "P H 2"], has_segment: Bool[np.ndarray, "P H-1"]
) -> Float[np.ndarray, "P H 2"]:
    """Unit normals at points; where nothing moves the last direction is kept."""
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
