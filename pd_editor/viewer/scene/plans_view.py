"""Draws what policies planned at the playhead's time, as thin lines."""

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.palette import Palette
from pd_editor.scene.policy import plans_at
from pd_editor.viewer.meshes.colors import inverse_aces, srgb_to_linear
from pd_editor.viewer.meshes.flat_mesh import Primitive, glb_of
from pd_editor.viewer.meshes.ribbons import path_heights, path_ribbons
from pd_editor.viewer.scene.original_view import DASH_WIDTH_M, HEIGHT_M
from pd_editor.viewer.tab.ui_context import UiContext


class PlansView:
    """One node of one browser with the plans of driven agents."""

    def __init__(self, ui: UiContext) -> None:
        """Draw nothing yet."""
        self._ui = ui
        self._handle: viser.GlbHandle | None = None
        self._palette: Palette | None = None
        self.shown: list[Float[np.ndarray, "F 2"]] = []
        """The plans that are drawn."""
        for signal in (ui.model.poses_drawn, ui.model.run_changed):
            signal.subscribe(self.show)

    def show(self) -> None:
        """Show the plans that were in force at the playhead."""
        plans, palette = self._plans(), self._ui.model.palette
        is_drawn = list(map(id, plans)) == list(map(id, self.shown))
        if is_drawn and palette is self._palette:
            return
        self.shown, self._palette = plans, palette
        if self._handle is not None:
            self._handle.visible = bool(plans)
        if not plans:
            return
        data = glb_of([_lines(plans, palette)])
        if self._handle is None:
            self._handle = self._ui.client.scene.add_glb(
                "/plans", data, cast_shadow=False, receive_shadow=False
            )
        else:
            self._handle.glb_data = data

    def _plans(self) -> list[Float[np.ndarray, "F 2"]]:
        """The latest plans of the agents that are there."""
        workspace, agents = self._ui.workspace, self._ui.session.scenario.agents
        step = int(workspace.playback.step)
        return plans_at(workspace.plans_in_force, agents, step)


def _lines(plans: list[Float[np.ndarray, "F 2"]], palette: Palette) -> Primitive:
    """Each plan twice: its rim, and itself on that."""
    longest, count = max(map(len, plans)), 2 * len(plans)
    along = np.arange(longest)
    points = np.stack([one[along.clip(max=len(one) - 1)] for one in plans])
    lengths = np.array([len(one) for one in plans])
    colors = np.array([palette.lane, palette.plan]) / 255.0
    # The rim sets a line off from the ribbon below.
    widths = np.tile((2 * DASH_WIDTH_M, DASH_WIDTH_M), len(plans))
    return path_ribbons(
        np.repeat(points, 2, axis=0),
        along < np.repeat(lengths, 2)[:, None],
        color=np.tile(inverse_aces(srgb_to_linear(colors)), (len(plans), 1)),
        opacity=np.ones((count, longest)),
        width_m=np.broadcast_to(widths[:, None], (count, longest)),
        height_m=path_heights(HEIGHT_M, np.arange(count)),
    )
