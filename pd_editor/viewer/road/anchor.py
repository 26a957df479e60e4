"""Where the road begins to bend: a gizmo to drag it with, and its mark on the road."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import viser

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.viewer.meshes.colors import shown_exactly
from pd_editor.viewer.meshes.flat_mesh import MeshNode, Primitive, ribbons
from pd_editor.viewer.tab.ui_context import UiContext

HEIGHT_M: Final = 0.095
HALF_WIDTH_M: Final = 9.0
"""Half the length of the line across the road."""
LINE_M: Final = 0.35
DASH_M: Final = 1.2


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
        position = (pose.x_m, pose.y_m, 0.3)
        half = pose.rotation_rad / 2
        wxyz = (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))
        if self._handle is not None:
            self._handle.position = position
            self._handle.wxyz = wxyz
            return
        self._handle = self._ui.client.scene.add_transform_controls(
            "/warp_anchor",
            scale=6.0,
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


class AnchorView:
    """One node of one browser with the anchor of a warp."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Draw nothing yet."""
        self._node = MeshNode(client, "/warp_start")
        self._drawn: tuple[RigidMotion, float] | None = None

    def show(self, pose: RigidMotion | None, border_m: float) -> None:
        """Mark a pose and the line ``border_m`` ahead of it; None takes it away."""
        if pose is None or not np.isfinite(border_m):
            self._drawn = None
            self._node.set_visible(False)
            return
        if self._drawn == (pose, border_m):
            return
        self._drawn = (pose, border_m)
        self._node.draw([_mark(pose, border_m)])
        self._node.set_visible(True)


def _mark(pose: RigidMotion, border_m: float) -> Primitive:
    """A bar across the road where it begins to bend, and dashes from the anchor."""
    across = np.array([[border_m, -HALF_WIDTH_M], [border_m, HALF_WIDTH_M]])
    arrow = np.array(
        [[border_m + 0.6, -1.2], [border_m + 2.2, 0.0], [border_m + 0.6, 1.2]]
    )
    starts = np.arange(0.0, border_m, 2 * DASH_M)
    dashes = [
        np.array([[start, 0.0], [min(start + DASH_M, border_m), 0.0]])
        for start in starts
        if border_m - start > LINE_M
    ]
    foot = np.array([[0.0, -1.5], [0.0, 1.5]])
    lines = ribbons(Lines.of([across, arrow, foot, *dashes]), LINE_M)
    return Primitive(
        points_m=pose.apply(lines.points_m),
        faces=lines.faces,
        height_m=HEIGHT_M,
        color=shown_exactly((130, 96, 210)),
        opacity=0.9,
    )
