"""Scale of the picture: sizes on the screen."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks

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
_FROM_ABOVE: Final = np.cos(np.radians(20.0))


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
        return bool(self.ahead[2] < -_FROM_ABOVE)

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
