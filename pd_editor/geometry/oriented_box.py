"""Rectangles with a heading: corners, overlap."""

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
    """Whether boxes share more than a touch (separating axis test).

    ``tolerance_m`` is the depth that two boxes may sink into each other before
    they count as overlapping.
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
