"""The tool that measures distances on the ground."""

import numpy as np

from pd_editor.viewer.overlay.messages import Ground, MeasureState
from pd_editor.viewer.tab.mode import Mode
from pd_editor.viewer.tab.ui_context import UiContext

SLOWEST_MPS = 0.3
"""Slower agents give no travel time for a measured distance."""


class Measure(Mode):
    """Mode in which distances are measured; the page manages points and labels."""

    name = "measure"

    def __init__(self, ui: UiContext) -> None:
        """Make the mode, switched off."""
        super().__init__(ui)
        self._start_m: Ground | None = None
        ui.model.scene_left.subscribe(self.stop)
        ui.model.shown.subscribe(self._show)

    def toggle(self) -> None:
        """Begin to measure, or end it."""
        self._start_m = None
        self._set_active(not self.is_active)

    def begin_at(self, point_m: np.ndarray) -> None:
        """Measure from a point of the ground on."""
        self.stop()
        self._start_m = float(point_m[0]), float(point_m[1])
        self._set_active(True)

    def _sentence(self) -> str:
        return "Measuring: click points; a double click ends the way; drag pans."

    def _show(self) -> None:
        """Send the speed of the selected agent, by which the page computes seconds."""
        speed_mps, agent = self._selected_speed() if self.is_active else (None, "")
        state = MeasureState(
            is_active=self.is_active,
            start=self._start_m,
            speed=speed_mps,
            agent=agent,
        )
        self._overlay.show(state)

    def _selected_speed(self) -> tuple[float | None, str]:
        """The first selected agent's speed at the current step, and what to call it."""
        scenario = self._ui.session.scenario
        agents, step = scenario.agents, scenario.current_step
        for agent_id in self._ui.session.selection[:1]:
            row = agents.row_of.get(agent_id)
            if row is None or not agents.is_valid[row, step]:
                continue
            speed_mps = float(np.hypot(*agents.velocity_mps[row, step]))
            if speed_mps > SLOWEST_MPS:
                return round(speed_mps, 2), f"{agents.kinds[row].value} {agent_id}"
        return None, ""
