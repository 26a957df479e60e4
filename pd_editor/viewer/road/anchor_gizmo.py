"""Arrows and a ring on the ground to drag a warp's anchor with."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import viser

from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.viewer.tab.ui_context import UiContext

SIZE_M: Final = 6.0
HEIGHT_M: Final = 0.3


class AnchorGizmo:
    """A pose on the map that the user can drag and turn."""

    def __init__(self, ui: UiContext, on_moved: Callable[[str], None]) -> None:
        """Show nothing yet; ``on_moved`` hears of start, updates and end of a drag."""
        self._ui = ui
        self._on_moved = on_moved
        self._handle: viser.TransformControlsHandle | None = None

    @property
    def pose(self) -> RigidMotion | None:
        """Pose of the gizmo; None while it is not shown."""
        if self._handle is None:
            return None
        w, _, _, z = self._handle.wxyz
        return RigidMotion(
            x_m=float(self._handle.position[0]),
            y_m=float(self._handle.position[1]),
            rotation_rad=float(2 * np.arctan2(z, w)),
        )

    def place(self, pose: RigidMotion) -> None:
        """Show it at a pose."""
        position = (pose.x_m, pose.y_m, HEIGHT_M)
        half = pose.rotation_rad / 2
        wxyz = (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))
        if self._handle is not None:
            self._handle.position = position
            self._handle.wxyz = wxyz
            return
        self._handle = self._ui.client.scene.add_transform_controls(
            "/warp_anchor",
            scale=SIZE_M,
            active_axes=(True, True, False),
            depth_test=False,
            position=position,
            wxyz=wxyz,
        )

        @self._handle.on_update
        async def _(event: Any) -> None:
            phase = event.phase
            self._ui.post(
                lambda: self._on_moved(phase),
                merge_key="anchor" if phase == "update" else None,
            )

    def remove(self) -> None:
        """Remove the gizmo."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
