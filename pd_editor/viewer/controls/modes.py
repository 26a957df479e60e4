"""Modes in which clicks on the picture mean something else; at most one is active."""

from collections.abc import Callable

from pd_editor.viewer.agents.placing import PlacingMode
from pd_editor.viewer.generation.region_drawing import RegionDrawing
from pd_editor.viewer.guidance.guiding import Guiding
from pd_editor.viewer.guidance.steering import Steering
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.overlay.banner import Banner
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.measure import Measure
from pd_editor.viewer.tab.ui_context import UiContext


class Modes:
    """Measuring, drawing a region, drawing a guidance term, placing agents."""

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        banner: Banner,
        *,
        poses: Callable[[], AgentPoses | None],
        on_change: Callable[[], None],
    ) -> None:
        """Make the modes, all switched off; ``on_change``: one has started or ended."""
        self._on_change = on_change
        self.measure = Measure(
            overlay, banner, ui.session, lambda _: self._changed(self.measure)
        )
        self.placing = PlacingMode(ui, overlay, banner)
        self.region = RegionDrawing(ui, overlay, banner)
        self.steering = Steering(ui, overlay, banner, poses)
        self._modes = (self.measure, self.region, self.steering.mode, self.placing)
        for mode in self._modes[1:]:
            mode.on_change(lambda mode=mode: self._changed(mode))

    @property
    def is_any_active(self) -> bool:
        """Whether a click on the picture belongs to a mode."""
        return any(mode.is_active for mode in self._modes)

    def leave(self) -> bool:
        """End the active mode; returns whether one was active."""
        for mode in self._modes:
            if mode.is_active:
                mode.stop()
                return True
        return False

    def leave_scene(self) -> None:
        """End the modes that refer to the former scenario, and remove the region."""
        self.measure.stop()
        self.region.clear()
        self.steering.mode.stop()

    def _changed(
        self, changed: Measure | RegionDrawing | Guiding | PlacingMode
    ) -> None:
        if changed.is_active:
            for mode in self._modes:
                if mode is not changed:
                    mode.stop()
        self._on_change()
