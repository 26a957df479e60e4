"""The tool that measures distances on the ground."""

from collections.abc import Callable

import numpy as np

from pd_editor.editor.session import EditorSession
from pd_editor.viewer.overlay.banner import MODE, Banner
from pd_editor.viewer.overlay.messages import Ground, MeasureState
from pd_editor.viewer.overlay.overlay import Overlay

SLOWEST_MPS = 0.3
"""Slower agents give no travel time for a measured distance."""


class Measure:
    """Mode in which distances are measured; the page manages points and labels."""

    def __init__(
        self,
        overlay: Overlay,
        banner: Banner,
        session: EditorSession,
        on_change: Callable[[bool], None],
    ) -> None:
        """Make the mode, switched off; ``on_change`` is called when it starts and ends."""
        self._overlay = overlay
        self._banner = banner
        self._session = session
        self._on_change = on_change
        self._is_active = False
        self._start_m: Ground | None = None

    @property
    def is_active(self) -> bool:
        """Whether clicks on the picture set points."""
        return self._is_active

    def toggle(self) -> None:
        """Begin to measure, or end it."""
        self._start_m = None
        self._set_active(not self._is_active)

    def begin_at(self, point_m: np.ndarray) -> None:
        """Measure from a point of the ground on."""
        self.stop()
        self._start_m = float(point_m[0]), float(point_m[1])
        self._set_active(True)

    def stop(self) -> None:
        """End measuring, if it is under way."""
        if self._is_active:
            self._set_active(False)

    def show(self) -> None:
        """Send the speed of the selected agent, by which the page computes seconds."""
        speed_mps, agent = self._selected_speed() if self._is_active else (None, "")
        state = MeasureState(
            is_active=self._is_active,
            start=self._start_m,
            speed=speed_mps,
            agent=agent,
        )
        self._overlay.show(state)

    def _set_active(self, is_active: bool) -> None:
        self._is_active = is_active
        if is_active:
            self._banner.show(
                "measure",
                "Measuring: click points; a double click ends the way; drag pans.",
                button="Done (Esc)",
                on_press=self.stop,
                priority=MODE,
            )
        else:
            self._banner.hide("measure")
        self.show()
        self._on_change(is_active)

    def _selected_speed(self) -> tuple[float | None, str]:
        """The first selected agent's speed at the current step, and what to call it."""
        scenario = self._session.scenario
        agents, step = scenario.agents, scenario.current_step
        for agent_id in self._session.selection[:1]:
            row = agents.row_of.get(agent_id)
            if row is None or not agents.is_valid[row, step]:
                continue
            speed_mps = float(np.hypot(*agents.velocity_mps[row, step]))
            if speed_mps > SLOWEST_MPS:
                return round(speed_mps, 2), f"{agents.kinds[row].value} {agent_id}"
        return None, ""
