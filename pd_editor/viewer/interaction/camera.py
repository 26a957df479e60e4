"""Views of the scene, and the way from pixels to the ground and back."""

from typing import Final, Protocol, runtime_checkable

import numpy as np
import viser
from jaxtyping import Float

TOP_VIEW_FOV_RAD: Final = np.radians(8.0)
"""So narrow that a perspective camera far away looks orthographic."""
PERSPECTIVE_FOV_RAD: Final = np.radians(42.0)
PERSPECTIVE_NEAR_FAR_M: Final = (1.5, 3000.0)
"""Near enough for a close look; nearer would cost depth precision far away."""
TOP_VIEW_HALF_HEIGHT_M: Final = 65.0
LOOK_AHEAD_M: Final = 14.0
"""How far ahead of an agent the default 3-D view looks."""
NEAR_FAR_MARGIN_M: Final = 400.0

Vector = tuple[float, float, float]


@runtime_checkable
class Perspective(Protocol):
    """What projecting needs to know of a camera."""

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
    """Where a ray meets the ground; None if it looks at the sky."""
    start, along = np.asarray(origin, float), np.asarray(direction, float)
    if along[2] > -1e-6:
        return None
    return (start + along * ((height_m - start[2]) / along[2]))[:2]


def dragged_ground_point(
    camera_position: Vector | np.ndarray, point: Vector | np.ndarray, height_m: float
) -> Float[np.ndarray, "2"] | None:
    """Ground under the pointer, from a point on viser's camera-facing drag plane."""
    start = np.asarray(camera_position, float)
    return ground_point(start, np.asarray(point, float) - start, height_m)


def projected(
    camera: Perspective, points_m: Float[np.ndarray, "N 3"]
) -> tuple[Float[np.ndarray, "N 2"], np.ndarray]:
    """Screen positions (0..1 from the top left), and which points lie ahead."""
    w, x, y, z = camera.wxyz
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
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


def look_from_behind(
    camera: viser.CameraHandle, target_m: Float[np.ndarray, "2"], heading_rad: float
) -> None:
    """The default 3-D view: from above and behind a point, along a heading."""
    position = target_m - 48.0 * np.array([np.cos(heading_rad), np.sin(heading_rad)])
    camera.up_direction = (0.0, 0.0, 1.0)
    camera.fov = float(PERSPECTIVE_FOV_RAD)
    camera.near, camera.far = PERSPECTIVE_NEAR_FAR_M
    camera.position = (float(position[0]), float(position[1]), 34.0)
    camera.look_at = (float(target_m[0]), float(target_m[1]), 0.0)


def look_from_above(
    camera: viser.CameraHandle, center_m: Float[np.ndarray, "2"]
) -> None:
    """A map-like view, north up."""
    distance = TOP_VIEW_HALF_HEIGHT_M / np.tan(TOP_VIEW_FOV_RAD / 2)
    x, y = float(center_m[0]), float(center_m[1])
    camera.up_direction = (0.0, 1.0, 0.0)
    camera.fov = float(TOP_VIEW_FOV_RAD)
    camera.near, camera.far = 20.0, float(distance + 20 * NEAR_FAR_MARGIN_M)
    camera.position = (x, y, float(distance))
    camera.look_at = (x, y, 0.0)
