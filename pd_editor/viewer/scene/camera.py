"""Cameras: projection between screen and ground, and sizes on the screen."""

from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks

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


MIN_LENGTH_PX: Final = 12.0
MIN_WIDTH_PX: Final = 8.0
"""Smaller glyphs of people are neither found nor hit by a click."""
ENLARGED_KINDS: Final = (
    AgentKind.PEDESTRIAN,
    AgentKind.CYCLIST,
    AgentKind.MOTORCYCLIST,
)
NOTICED_CHANGE: Final = 0.15
"""Sizes are kept until the zoom has changed by this share."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewScale:
    """Parameters of the camera that determine sizes on the screen."""

    position_m: Float[np.ndarray, "3"]
    ahead: Float[np.ndarray, "3"]
    """Unit vector into the picture."""
    up: Float[np.ndarray, "3"]
    """Unit vector up the picture."""
    focal_px: float
    distance_m: float
    """Distance to the point that the camera looks at."""

    @classmethod
    def of(cls, camera: viser.CameraHandle) -> "ViewScale":
        """The scale of a browser's camera."""
        return cls.of_pose(
            wxyz=camera.wxyz,
            position_m=camera.position,
            look_at_m=camera.look_at,
            fov_rad=camera.fov,
            height_px=camera.image_height,
        )

    @classmethod
    def of_pose(
        cls,
        *,
        wxyz: np.ndarray,
        position_m: np.ndarray,
        look_at_m: np.ndarray,
        fov_rad: float,
        height_px: int,
    ) -> "ViewScale":
        """The scale of a camera that looks along its z axis, y down the picture."""
        w, x, y, z = wxyz
        down = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
        ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
        position = np.array(position_m, float)
        return cls(
            position_m=position,
            ahead=np.array(ahead, float),
            up=-np.array(down, float),
            focal_px=height_px / 2 / float(np.tan(fov_rad / 2)),
            distance_m=float(np.linalg.norm(np.array(look_at_m, float) - position)),
        )

    @property
    def is_from_above(self) -> bool:
        """Whether the picture is all but a map."""
        return bool(self.ahead[2] < -np.cos(np.radians(20.0)))

    def pixels_per_m(
        self, points_m: Float[np.ndarray, "N 3"]
    ) -> Float[np.ndarray, "N"]:
        """Pixels of one metre across the line of sight, at points of the scene."""
        depth = (points_m - self.position_m) @ self.ahead
        return self.focal_px / np.maximum(depth, 1.0)

    def differs_from(self, other: "ViewScale") -> bool:
        """Whether elements sized for the other scale must be resized."""
        if self.is_from_above != other.is_from_above:
            return True
        if self.is_from_above and self.up @ other.up < np.cos(0.1):
            return True
        ratio = (self.focal_px * other.distance_m) / (other.focal_px * self.distance_m)
        moved = 0.0
        if not self.is_from_above:
            gap = np.linalg.norm(self.position_m - other.position_m)
            moved = float(gap) / self.distance_m
        return bool(abs(np.log(ratio)) > NOTICED_CHANGE or moved > NOTICED_CHANGE)


def drawn_sizes_m(
    agents: AgentTracks, view: ViewScale | None
) -> Float[np.ndarray, "A 2"]:
    """Length and width with which agents are drawn.

    From above, people get at least the smallest glyph; all else has its true size.
    """
    if view is None or not view.is_from_above:
        return agents.size_m
    pixels = agents.size_m * (view.focal_px / max(view.distance_m, 1.0))
    factor = (np.array([MIN_LENGTH_PX, MIN_WIDTH_PX]) / np.maximum(pixels, 1e-9)).max(1)
    factor = np.where(agents.kind_mask(ENLARGED_KINDS), np.maximum(factor, 1.0), 1.0)
    return agents.size_m * factor[:, None]
