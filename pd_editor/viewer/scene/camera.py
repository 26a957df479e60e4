"""Projection between screen positions and the ground."""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

Vector = tuple[float, float, float]


@runtime_checkable
class Perspective(Protocol):
    """Interface of a camera for projections."""

    @property
    def position(self) -> Float[np.ndarray, "3"]: ...  # noqa: D102
    @property
    def wxyz(self) -> Float[np.ndarray, "4"]: ...  # noqa: D102
    @property
    def fov(self) -> float: ...  # noqa: D102
    @property
    def aspect(self) -> float: ...  # noqa: D102


def ground_point(
    origin: Vector | np.ndarray, direction: Vector | np.ndarray, height_m: float = 0.0
) -> Float[np.ndarray, "2"] | None:
    """Intersection of a ray with the ground; None for the sky."""
    start, along = np.asarray(origin, float), np.asarray(direction, float)
    if along[2] > -1e-6:
        return None
    return (start + along * ((height_m - start[2]) / along[2]))[:2]


def projected(
    camera: Perspective, points_m: Float[np.ndarray, "N 3"]
) -> tuple[Float[np.ndarray, "N 2"], np.ndarray]:
    """Screen positions (0..1 from the top left), and which points lie ahead."""
    rotation = _rotation(camera)
    local = (points_m - camera.position) @ rotation
    depth = np.maximum(local[:, 2], 1e-6)
    half_height = np.tan(camera.fov / 2)
    screen = np.stack(
        [
            0.5 + local[:, 0] / depth / (2 * half_height * camera.aspect),
            0.5 + local[:, 1] / depth / (2 * half_height),
        ],
        axis=-1,
    )
    return screen, local[:, 2] > 0


def ray_through(
    camera: Perspective, screen: tuple[float, float]
) -> Float[np.ndarray, "3"]:
    """Direction from the camera through a screen position (0..1 from the top left)."""
    half_height = np.tan(camera.fov / 2)
    local = np.array(
        [
            (screen[0] - 0.5) * 2 * half_height * camera.aspect,
            (screen[1] - 0.5) * 2 * half_height,
            1.0,
        ]
    )
    return _rotation(camera) @ local


def _rotation(camera: Perspective) -> Float[np.ndarray, "3 3"]:
    """From the camera's axes (right, down, ahead) to those of the scene."""
    w, x, y, z = camera.wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
