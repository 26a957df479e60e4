"""The candidates panel: where a selected agent could go."""

from typing import Final

import numpy as np

from pd_editor.editor.commands import AdoptTrajectory
from pd_editor.errors import EditError
from pd_editor.paths.motion_primitives import CandidateSet, candidates
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.desk import Desk, set_property, set_value
from pd_editor.viewer.views.candidates_view import CandidatesView

NO_CANDIDATE: Final[str] = "-"


class CandidatesPanel:
    """Shows an agent's candidates and has one of them adopted."""

    def __init__(self, desk: Desk, view: CandidatesView) -> None:
        """Build it into the current tab."""
        self._desk = desk
        self._view = view
        self._agent_id: str | None = None
        self._base: Scenario | None = None
        gui = desk.client.gui
        with gui.add_folder("Where could it go"):
            self._show = gui.add_button(
                "Show candidates", color="gray", hint="G; for one selected agent"
            )
            self._choice = gui.add_dropdown("Candidate", (NO_CANDIDATE,), visible=False)
            self._adopt = gui.add_button("Adopt candidate", visible=False)
        self._desk.on_click(self._show, self.toggle_candidates)
        self._desk.on_click(self._adopt, self._adopt_chosen)
        self._desk.on_change(self._choice, lambda _value: self._highlight())

    @property
    def shows_candidates(self) -> bool:
        """Whether the fan is drawn."""
        return self._view.shown is not None

    def show(self, scenario: Scenario, selection: tuple[str, ...]) -> None:
        """Follow the session: a fan of an agent that changed or left is put away."""
        set_property(self._show, "disabled", len(selection) != 1)
        if self._agent_id is None:
            return
        if selection != (self._agent_id,):
            self.hide_candidates()
        elif scenario is not self._base:
            self._draw_candidates(scenario)

    def toggle_candidates(self) -> None:
        """Show where the selected agent could go, or put the fan away."""
        if self.shows_candidates:
            self.hide_candidates()
            return
        selection = self._desk.session.selection
        if len(selection) != 1:
            raise EditError("Select one agent to see where it could go.")
        self._agent_id = selection[0]
        self._draw_candidates(self._desk.session.scenario)

    def hide_candidates(self) -> None:
        """Put the fan away."""
        self._agent_id, self._base = None, None
        self._view.show(None)
        set_property(self._show, "label", "Show candidates")
        set_property(self._choice, "visible", False)
        set_property(self._adopt, "visible", False)

    def adopt_near(self, point_m: np.ndarray) -> bool:
        """Adopt the candidate that was clicked; False if none was hit."""
        index = self._view.candidate_near(point_m)
        if index is None:
            return False
        self._adopt_candidate(index)
        return True

    def _draw_candidates(self, scenario: Scenario) -> None:
        assert self._agent_id is not None
        rows = scenario.agents.rows([self._agent_id])
        if not scenario.agents.is_valid[rows[0], scenario.current_step]:
            self.hide_candidates()
            raise EditError(f"Agent {self._agent_id} is not there at the current step.")
        found = candidates(scenario, rows)
        self._base = scenario
        self._view.show(found, scenario.road_map)
        self._choice.options = (NO_CANDIDATE, *candidate_labels(found))
        set_value(self._choice, NO_CANDIDATE)
        set_property(self._choice, "visible", True)
        set_property(self._adopt, "visible", True)
        set_property(self._show, "label", "Hide candidates")

    def _chosen_index(self) -> int | None:
        options = tuple(self._choice.options)
        value = self._choice.value
        return None if value == NO_CANDIDATE else options.index(value) - 1

    def _highlight(self) -> None:
        if self._view.shown is not None:
            index = self._chosen_index()
            valid = np.flatnonzero(self._view.shown.is_valid[0])
            self._view.show(
                self._view.shown,
                self._desk.session.scenario.road_map,
                None if index is None else int(valid[index]),
            )

    def _adopt_chosen(self) -> None:
        index = self._chosen_index()
        if index is None or self._view.shown is None:
            raise EditError("Choose a candidate in the list, or click one on the road.")
        self._adopt_candidate(int(np.flatnonzero(self._view.shown.is_valid[0])[index]))

    def _adopt_candidate(self, index: int) -> None:
        found, agent_id = self._view.shown, self._agent_id
        assert found is not None
        assert agent_id is not None
        self.hide_candidates()
        self._desk.apply(
            AdoptTrajectory.of_arrays(
                agent_id=agent_id,
                position_m=found.position_m[0, index],
                heading_rad=found.heading_rad[0, index],
                velocity_mps=found.velocity_mps[0, index],
            )
        )


def candidate_labels(found: CandidateSet) -> tuple[str, ...]:
    """A short unique text for each valid candidate of the first agent."""
    labels: list[str] = []
    for index in np.flatnonzero(found.is_valid[0]):
        speed = float(found.target_speed_mps[0, index])
        shift = float(found.lateral_shift_m[0, index])
        if found.is_standstill[0, index]:
            text = "stand still"
        elif found.is_lane_change[0, index]:
            text = f"{speed:.1f} m/s, change lane"
        elif abs(shift) > 0.2:
            side = "left" if shift > 0 else "right"
            text = f"{speed:.1f} m/s, {abs(shift):.1f} m to the {side}"
        else:
            text = f"{speed:.1f} m/s"
        labels.append(f"{len(labels) + 1}. {text}")
    return tuple(labels)
