"""Oriented boxes: corners, overlap test and overlap area."""

import numpy as np
from jaxtyping import Bool, Float

_CORNER_SIGNS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) / 2


def box_corners(
    center_m: Float[np.ndarray, "*shape 2"],
    heading_rad: Float[np.ndarray, "*shape"],
    size_m: Float[np.ndarray, "*shape 2"],
) -> Float[np.ndarray, "*shape 4 2"]:
    """Corners, counter-clockwise from front left; size is length, width."""
    local = _CORNER_SIGNS * size_m[..., None, :]
    cos, sin = np.cos(heading_rad)[..., None], np.sin(heading_rad)[..., None]
    x = cos * local[..., 0] - sin * local[..., 1]
    y = sin * local[..., 0] + cos * local[..., 1]
    return center_m[..., None, :] + np.stack([x, y], axis=-1)


def boxes_overlap(
    corners_a_m: Float[np.ndarray, "*shape 4 2"],
    corners_b_m: Float[np.ndarray, "*shape 4 2"],
    tolerance_m: float = 0.0,
) -> Bool[np.ndarray, "*shape"]:
    """Whether boxes overlap (separating axis test); touching boxes do not.

    Boxes that penetrate each other by at most ``tolerance_m`` do not count either.
    """
    separated = np.zeros(corners_a_m.shape[:-2], bool)
    for corners in (corners_a_m, corners_b_m):
        for first, second in ((0, 1), (1, 2)):
            axis = corners[..., second, :] - corners[..., first, :]
            axis = axis / np.maximum(
                np.linalg.norm(axis, axis=-1, keepdims=True), 1e-12
            )
            along_a = np.einsum("...cd,...d->...c", corners_a_m, axis)
            along_b = np.einsum("...cd,...d->...c", corners_b_m, axis)
            gap = np.maximum(
                along_a.min(-1) - along_b.max(-1), along_b.min(-1) - along_a.max(-1)
            )
            separated |= gap >= -tolerance_m
    return ~separated


def overlap_area(
    corners_a_m: Float[np.ndarray, "P 4 2"], corners_b_m: Float[np.ndarray, "P 4 2"]
) -> Float[np.ndarray, "P"]:
    """Area in m^2 that pairs of boxes share; corners as ``box_corners`` orders them.

    Seen from box b, box a is clipped at two pairs of parallel lines. Points outside
    are moved onto the line rather than dropped, which encloses the same area.
    """
    center = corners_b_m.mean(axis=1, keepdims=True)
    points = corners_a_m - center
    for end, start in ((0, 1), (1, 2)):
        side = corners_b_m[:, end] - corners_b_m[:, start]
        length = np.hypot(side[:, 0], side[:, 1])
        axis = side / np.maximum(length, 1e-12)[:, None]
        points = _clipped_to_strip(points, axis, length / 2)
    following = np.roll(points, -1, axis=1)
    cross = points[..., 0] * following[..., 1] - points[..., 1] * following[..., 0]
    return np.maximum(cross.sum(axis=1) / 2, 0.0)


def _clipped_to_strip(
    ring: Float[np.ndarray, "P V 2"],
    axis: Float[np.ndarray, "P 2"],
    half_width: Float[np.ndarray, "P"],
) -> Float[np.ndarray, "P W 2"]:
    """Rings clipped to |point . axis| <= half width; each edge gives three points."""
    along = np.einsum("pvd,pd->pv", ring, axis)
    step, rise = np.roll(ring, -1, axis=1) - ring, np.roll(along, -1, axis=1) - along
    flat = np.abs(rise) < 1e-12
    bounds = half_width[:, None, None] * np.array([-1.0, 1.0])
    crossing = (bounds - along[..., None]) / np.where(flat, 1.0, rise)[..., None]
    crossing = np.where(flat[..., None], 0.0, np.clip(crossing, 0.0, 1.0))
    fraction = np.concatenate(
        [np.zeros((*along.shape, 1)), np.sort(crossing, axis=-1)], axis=-1
    )
    points = ring[:, :, None] + fraction[..., None] * step[:, :, None]
    reach = along[..., None] + fraction * rise[..., None]
    excess = reach - np.clip(reach, bounds[..., :1], bounds[..., 1:])
    points = points - excess[..., None] * axis[:, None, None]
    return points.reshape(len(ring), 3 * ring.shape[1], 2)
