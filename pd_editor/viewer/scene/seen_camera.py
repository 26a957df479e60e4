"""The camera through which the browser shows the picture."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.viewer.scene.camera import projected

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
