"""Projection between screen positions and the ground."""

from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import viser
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


SAME_PIXEL: Final = 0.004
"""Share of the picture by which a point may be away from where it was seen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPose:
    """Pose and field of view of a camera."""

    position: Float[np.ndarray, "3"]
    wxyz: Float[np.ndarray, "4"]
    fov: float
    aspect: float

    def sees(
        self,
        point_m: tuple[float, float, float],
        screen_position: tuple[float, float],
        tolerance: float = SAME_PIXEL,
    ) -> bool:
        """Whether a point of the scene appears at a position of the screen (0..1)."""
        screen, is_ahead = projected(self, np.asarray(point_m, float)[None])
        gap = np.abs(screen[0] - np.asarray(screen_position))
        return bool(is_ahead[0] and (gap < tolerance).all())


class SeenCamera:
    """Follows the camera that the browser reports.

    ``client.camera`` has the pose that the server requested, although the browser shows
    the former view until the request arrives. Pointer events refer to what the browser
    showed, which is the pose that it reported last: its messages keep their order.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        """Take the known pose, then follow the browser's reports."""
        self.pose = _pose_of(client.camera)

        @client.camera.on_update
        async def _(camera: Any) -> None:
            self.pose = _pose_of(camera)


def _pose_of(camera: viser.CameraHandle) -> CameraPose:
    return CameraPose(
        position=np.array(camera.position, float),
        wxyz=np.array(camera.wxyz, float),
        fov=float(camera.fov),
        aspect=float(camera.aspect),
    )
