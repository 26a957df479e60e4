"""The drive panel: where a selected agent could go, and regenerating futures."""

import time
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import viser

from pd_editor.editor.commands import AdoptTrajectory, Command, traffic_command
from pd_editor.editor.generation_job import GenerationJob
from pd_editor.errors import EditError, GenerationError
from pd_editor.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    ScenarioGenerator,
)
from pd_editor.paths.motion_primitives import CandidateSet, candidates
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_choice import drivable_agent_ids
from pd_editor.viewer.candidates_view import CandidatesView
from pd_editor.viewer.desk import Desk, set_property, set_value
from pd_editor.viewer.page_text import plain

SCOPES: Final = ("All agents", "Selection")
NO_CANDIDATE: Final[str] = "-"


class DrivePanel:
    """Candidates of one agent; the generator, its seed, progress and cancel."""

    def __init__(
        self,
        desk: Desk,
        view: CandidatesView,
        generators: Mapping[str, Callable[[], ScenarioGenerator]],
    ) -> None:
        """Build it into the current tab."""
        self._desk = desk
        self._view = view
        self._generators = generators
        self._agent_id: str | None = None
        self._base: Scenario | None = None
        self._job: GenerationJob | None = None
        self._offered: tuple[Scenario, Command] | None = None
        self._session_base = desk.session.base
        gui = desk.client.gui
        with gui.add_folder("Where could it go"):
            self._show = gui.add_button(
                "Show candidates", color="gray", hint="G; for one selected agent"
            )
            self._choice = gui.add_dropdown("Candidate", (NO_CANDIDATE,), visible=False)
            self._adopt = gui.add_button("Adopt candidate", visible=False)
        with gui.add_folder("Regenerate futures"):
            self._model = gui.add_dropdown("Generator", tuple(generators))
            self._scope = gui.add_dropdown("Agents", SCOPES)
            self._seed = gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1)
            self._renews = gui.add_checkbox("New seed after each run", True)
            self._run = gui.add_button(
                "Regenerate", icon=viser.Icon.PLAYER_PLAY, hint="R"
            )
            self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
            self._status = gui.add_markdown("")
            self._cancel = gui.add_button("Cancel", color="red", visible=False)
            self._take = gui.add_button("Apply the offered result", visible=False)
        self._desk.on_click(self._show, self.toggle_candidates)
        self._desk.on_click(self._adopt, self._adopt_chosen)
        self._desk.on_change(self._choice, lambda _value: self._highlight())
        self._desk.on_click(self._run, self.regenerate)
        self._desk.on_click(self._cancel, self.cancel)
        self._desk.on_click(self._take, self._take_offered)

    @property
    def shows_candidates(self) -> bool:
        """Whether the fan is drawn."""
        return self._view.shown is not None

    def show(self, scenario: Scenario, selection: tuple[str, ...]) -> None:
        """Follow the session: a fan of an agent that changed or left is put away."""
        set_property(self._show, "disabled", len(selection) != 1)
        if self._desk.session.base is not self._session_base:
            self._session_base = self._desk.session.base
            self._offered = None
            set_property(self._take, "visible", False)
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

    def regenerate(self) -> None:
        """Start the generator on the selection or on all agents."""
        if self._job is not None:
            raise GenerationError("A generation is running already; cancel it first.")
        self._desk.commit_gesture()
        session = self._desk.session
        agent_ids = drivable_agent_ids(
            session.scenario,
            session.selection if self._scope.value == "Selection" else None,
        )
        request = GenerationRequest(
            scenario=session.scenario, agent_ids=agent_ids, seed=int(self._seed.value)
        )
        self._set_running(True)
        generator = self._generators[self._model.value]()
        started = time.monotonic()
        post = self._desk.post

        def only_if_current(action: Callable[[], None]) -> Callable[[], None]:
            return lambda: action() if self._job is job else None

        job = GenerationJob(
            generator=generator,
            request=request,
            on_progress=lambda p: post(
                only_if_current(lambda: self._progressed(p)), "progress"
            ),
            on_done=lambda t: post(
                only_if_current(lambda: self._finished(request, t, started))
            ),
            on_error=lambda e: post(only_if_current(lambda: self._failed(e))),
        )
        self._job = job
        job.start()

    def close(self) -> None:
        """Stop what runs; nobody is there to take it."""
        if self._job is not None:
            self._job.cancel()

    def cancel(self) -> None:
        """Stop the generator within one step; nothing changes."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
            self._set_running(False)
            set_property(self._status, "content", "Cancelled.")

    def _progressed(self, progress: GenerationProgress) -> None:
        set_value(self._progress, round(100 * progress.fraction, 1))
        set_property(self._status, "content", plain(progress.message))

    def _finished(
        self, request: GenerationRequest, traffic: GeneratedTraffic, started: float
    ) -> None:
        self._job = None
        self._set_running(False)
        command = traffic_command(request, traffic)
        count = len(request.agent_ids)
        seconds = time.monotonic() - started
        note = plain(" ".join(traffic.notes))
        status = f"{count} futures in {seconds:.1f} s, seed {request.seed}. {note}"
        if self._renews.value:
            set_value(self._seed, int(self._seed.value) + 1)
        if self._desk.session.scenario is request.scenario:
            self._desk.apply(command)
        else:
            self._offered = (request.scenario, command)
            set_property(self._take, "visible", True)
            status += " The scenario was edited meanwhile; apply it if it still fits."
        set_property(self._status, "content", status)

    def _take_offered(self) -> None:
        if self._offered is None:
            return
        (made_for, command), self._offered = self._offered, None
        set_property(self._take, "visible", False)
        now = self._desk.session.scenario
        if now.road_map is not made_for.road_map or not _same_states(made_for, now):
            raise GenerationError(
                "The road or agents have changed since that was generated, so it no "
                "longer fits; regenerate instead."
            )
        self._desk.apply(command)

    def _failed(self, error: Exception) -> None:
        self._job = None
        self._set_running(False)
        set_property(self._status, "content", "")
        self._desk.report(error)

    def _set_running(self, is_running: bool) -> None:
        set_property(self._run, "disabled", is_running)
        set_property(self._progress, "visible", is_running)
        set_property(self._cancel, "visible", is_running)
        set_value(self._progress, 0.0)


def _same_states(one: Scenario, other: Scenario) -> bool:
    """Whether the same agents stand alike at the current step."""
    step = one.current_step
    return one.agents.ids == other.agents.ids and all(
        np.array_equal(
            getattr(one.agents, name)[:, step], getattr(other.agents, name)[:, step]
        )
        for name in ("position_m", "heading_rad", "velocity_mps", "is_valid")
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
