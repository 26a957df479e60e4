"""Curve of speed of the selected agent, above the timeline, which can be pulled."""

from itertools import count

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.metrics.motion import COMFORT
from pd_editor.analysis.metrics.scene_metrics import acceleration_of
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import Command, PullSpeed, SetAgentSpeed
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.viewer.overlay.messages import SpeedCurveEvent, SpeedCurveState
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.tab.ui_context import UiContext


class SpeedCurve:
    """The element ``speedCurve``: shows the speeds of one agent, and edits them.

    A pull is a gesture, from the first speed to the release. At t = 0 it sets the current
    speed; later it retimes the agent along its trajectory, and the playhead goes there.
    """

    def __init__(self, ui: UiContext, timeline: Timeline) -> None:
        """Show it while one agent is selected."""
        self._ui, self._timeline = ui, timeline
        self._numbers = count()
        self._owner = ""
        ui.overlay.on("speedCurve", self._heard)
        ui.model.shown.subscribe(self.show)

    def show(self) -> None:
        """Follow scenario and selection."""
        session = self._ui.session
        scenario, selection = session.scenario, session.selection
        rows = scenario.agents.rows(selection)
        if len(rows) != 1 or not scenario.agents.is_valid[rows[0]].any():
            self._ui.overlay.show(SpeedCurveState())
            self._ui.model.covered["speeds"] = 0
            return
        self._ui.model.covered["speeds"] = 244  # With what is below and above.
        row = int(rows[0])
        original = session.original.agents
        speeds, former = _speeds(scenario.agents, row), ()
        if selection[0] in original.row_of:
            former = _speeds(original, original.row_of[selection[0]])
        acceleration = acceleration_of(scenario, row)
        is_harsh = (acceleration > COMFORT.acceleration_mps2) | (
            acceleration < COMFORT.braking_mps2
        )
        now = scenario.current_step
        self._ui.overlay.show(
            SpeedCurveState(
                agent=selection[0],
                begin_step=-now,
                speeds=speeds,
                former=former if former != speeds else (),
                harsh=tuple((np.flatnonzero(is_harsh) - now).tolist()),
            )
        )

    def _heard(self, event: SpeedCurveEvent) -> None:
        ui, kind = self._ui, event.kind
        is_held = ui.gesture is not None and ui.gesture == self._owner
        if kind != "pull":
            if is_held:
                ui.end_gesture() if kind == "release" else ui.abort_gesture()
            self._owner = ""
            return
        if self._owner and not is_held:
            # Something else has ended the gesture; the rest of the pull means nothing.
            return
        selection = ui.session.selection
        if len(selection) != 1:
            raise EditError("No speed is pulled; expected one selected agent.")
        self._owner = self._owner or f"speed curve {next(self._numbers)}"
        axis = ui.session.scenario.time_axis
        step = event.step
        if 0 < step <= axis.num_future_steps:
            self._timeline.seek(float(axis.current_step + step))
        pull: Command = SetAgentSpeed(agent_ids=selection, speed_mps=event.speed)
        if step:
            agent, time_s = selection[0], step * axis.step_s
            pull = PullSpeed(agent_id=agent, time_s=time_s, speed_mps=event.speed)
        try:
            ui.preview(self._owner, pull)
        except EditError:
            # Said once; the rest of the pull would say it again at each event.
            ui.abort_gesture()
            raise


def _speeds(agents: AgentTracks, row: int) -> tuple[float | None, ...]:
    speed: Float[np.ndarray, "T"] = np.hypot(*agents.velocity_mps[row].T)
    return tuple(
        round(value, 2) if there else None
        for value, there in zip(speed.tolist(), agents.is_valid[row], strict=True)
    )
