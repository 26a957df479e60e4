"""Signals of the road's junctions: sampled phases, and green by a click."""

import numpy as np

from pd_editor.editor.commands import GiveGreen, RemoveSignals, SampleSignals
from pd_editor.scene.junction_phases import junctions, signals_with_green
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property


class SignalsPanel:
    """Buttons for signals, and clicks on stop lines while there are some."""

    def __init__(self, ui: UiContext) -> None:
        """Build it into the current folder."""
        self._ui = ui
        gui = ui.client.gui
        self._sample = gui.add_button(
            "Sample signals",
            hint="Gives each junction a plausible phase. Agents that are resampled or "
            "regenerated afterwards wait or go by it.",
        )
        self._remove = gui.add_button("Remove signals", color="gray", disabled=True)
        self._text = FixedText(gui, 2, grows=True)
        ui.on_click(self._sample, self.sample)
        ui.on_click(self._remove, lambda: ui.apply(RemoveSignals()))
        ui.model.ground_clicked.subscribe(self._clicked)
        ui.model.shown.subscribe(self._show)

    def sample(self) -> None:
        """Sample the phases of all junctions, other ones at each click."""
        self._ui.apply(SampleSignals(seed=int(np.random.default_rng().integers(2**31))))

    def _clicked(self, point_m: np.ndarray) -> bool:
        """Give the lane of a clicked stop line green, while nothing is selected."""
        scenario = self._ui.session.scenario
        if not scenario.signals or self._ui.session.selection or self._ui.model.mode:
            return False
        gap = np.linalg.norm(scenario.stop_lines_m()[:, 1] - point_m[:2], axis=-1)
        lanes = [lane for one in scenario.signals for lane in one.lane_ids]
        # A click this near to a stop line is meant for it.
        if gap.min() > 3.0:
            return False
        clicked = scenario.road_map.lane_of[lanes[int(gap.argmin())]]
        # Movements that part begin at one stop line: that of the lane before them.
        before = [n for n in clicked.predecessors if n in scenario.road_map.lane_of]
        lane_id = before[0] if before else clicked.lane_id
        has_phase = signals_with_green(scenario, lane_id) is not None
        if has_phase:
            self._ui.apply(GiveGreen(lane_id=lane_id))
        return has_phase

    def _show(self) -> None:
        scenario = self._ui.session.scenario
        has_some = bool(junctions(scenario.original_road_map))
        set_property(self._sample, "disabled", not has_some)
        set_property(self._remove, "disabled", not scenario.signals)
        if scenario.signals:
            self._text.show(
                "",
                "With nothing selected, click a stop line to give its lane green for the whole time.",
            )
        elif has_some:
            self._text.show("", "No signals: who waits is the model's choice.")
        else:
            self._text.show("", "No junction here has lanes that cross.")
