"""Angles in radians, counter-clockwise from +x."""

import numpy as np
from jaxtyping import Float


def wrap_angle(angle_rad: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Map angles to (-pi, pi]."""
    return -((np.pi - np.asarray(angle_rad, float)) % (2 * np.pi) - np.pi)


def wrap_outside(angle_rad: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Map angles outside (-pi, pi] to it; the others keep all their bits."""
    is_outside = (angle_rad <= -np.pi) | (angle_rad > np.pi)
    return np.where(is_outside, wrap_angle(angle_rad), angle_rad)


def heading_of(direction: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape"]:
    """Angle of direction vectors; 0 for the zero vector."""
    return np.arctan2(direction[..., 1], direction[..., 0])


def unit_vector(
    heading_rad: float | Float[np.ndarray, "*shape"],
) -> Float[np.ndarray, "*shape 2"]:
    """Unit vectors that point along headings."""
    return np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=-1)


def left_of(direction: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape 2"]:
    """Vectors turned by +90 degrees."""
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


def turned(
    vectors: Float[np.ndarray, "*shape 2"],
    angle_rad: float | Float[np.ndarray, "*#shape"],
) -> Float[np.ndarray, "*shape 2"]:
    """Vectors turned counter-clockwise by angles, which are broadcast."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def interpolate_angle(
    start_rad: Float[np.ndarray, "..."],
    end_rad: Float[np.ndarray, "..."],
    fraction: Float[np.ndarray, "..."],
) -> Float[np.ndarray, "..."]:
    """Angle between two angles, going the short way round."""
    return wrap_angle(start_rad + fraction * wrap_angle(end_rad - start_rad))
