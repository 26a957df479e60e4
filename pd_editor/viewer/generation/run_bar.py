"""The bar under the timeline that starts runs and tells how they go, and the switch of live regeneration."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.base.errors import GenerationError
from pd_editor.editor.edit_findings import generated_agent_ids
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import RunBarEvent, RunBarState, RunVerb, Tone
from pd_editor.viewer.scene.original_view import changed_rows
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.state.view_memory import LiveAgents
from pd_editor.viewer.tab.tab_model import RunState
from pd_editor.viewer.tab.ui_context import UiContext

SCOPE_USUAL: Final = "The selection, else the guided, else all"
SCOPE_ALL: Final = "All agents"
IN_REGION: Final = "In the region I draw"
SCOPES: Final = (SCOPE_USUAL, SCOPE_ALL, IN_REGION)
LIMITS: Final = {"samples": (1, 16), "seed": (0, 2**31 - 1)}
"""Least and greatest value of each number."""


class RunBar:
    """The element ``run``, and what is set in it: samples, seed, and whose trajectories."""

    def __init__(self, ui: UiContext, acts: Mapping[str, Callable[[], None]]) -> None:
        """``acts`` are what its buttons do, and what follows a choice, by their names."""
        self._overlay = ui.overlay
        self._kept = kept = ui.workspace.drive_settings
        self._acts = acts
        self.samples: int = kept.get("samples", 1)
        self.seed: int = kept.get("seed", 0)
        self.scope: str = kept.get("scope", SCOPE_USUAL)
        ui.overlay.on("run", self._heard)

    def keep(self) -> None:
        """Keep what is set for the next page."""
        self._kept.update(samples=self.samples, seed=self.seed, scope=self.scope)

    def show(
        self,
        verbs: tuple[RunVerb, RunVerb],
        run: RunState | None,
        said: str,
        tone: Tone,
    ) -> None:
        """Show whom runs are about, and the run; ``said`` is shown without one."""
        state = RunBarState(
            verbs=verbs,
            scope=self.scope,
            scopes=SCOPES,
            samples=self.samples,
            seed=self.seed,
            limits=LIMITS,
            text=run.text if run is not None and run.text else said,
            tone="busy" if run is not None else tone,
            fraction=None if run is None else run.fraction,
            action="" if run is None else run.action,
        )
        self._overlay.show(state)

    def _heard(self, event: RunBarEvent) -> None:
        """Take a choice, or do what a button does."""
        kind, value = event.kind, event.value
        if kind == "scope" and value in SCOPES:
            self.scope = str(value)
        elif kind in LIMITS and isinstance(value, int):
            least, most = LIMITS[kind]
            setattr(self, kind, min(max(value, least), most))
        if kind in self._acts:
            self._acts[kind]()


GENERATED: Final = "Generated ones"
ALL: Final = "All agents"
_NEAREST: Final = 16
"""Number of agents that react during an edit if more than four times as many could."""
_SCOPES: Final[dict[str, LiveAgents]] = {GENERATED: "generated", ALL: "all"}


def nearest_to_edit(
    before: Scenario, edited: Scenario, ids: tuple[str, ...]
) -> tuple[str, ...]:
    """Of very many agents, those near the edited ones, if the road is as before."""
    agents, now = edited.agents, edited.current_step
    rows = changed_rows(agents, before.agents)
    is_other = edited.road_map is not before.road_map
    if len(ids) <= 4 * _NEAREST or is_other or not len(rows):
        return ids
    place = agents.position_m[:, now]
    gap = np.hypot(*(place[agents.rows(ids), None] - place[rows]).T)
    near = np.fmin.reduce(gap, axis=0).argsort(kind="stable")[:_NEAREST]
    return tuple(ids[index] for index in np.sort(near))


def retimed_ids(before: Scenario, edited: Scenario) -> frozenset[str]:
    """Ids of agents whose later motion alone an edit sets, and which therefore keep it."""
    old, new, now = before.agents, edited.agents, edited.current_step
    if old is new or old.ids != new.ids or edited.road_map is not before.road_map:
        return frozenset()
    differs = (old.velocity_mps != new.velocity_mps).any(axis=-1)
    rows = np.flatnonzero(differs.any(axis=1) & ~differs[:, now])
    return frozenset(new.ids[row] for row in rows)


class LiveSwitch:
    """Live or not, and a menu of whom; the choices are kept for the next connection."""

    def __init__(self, ui: UiContext) -> None:
        """Build it into the current folder."""
        self._ui = ui
        self.switched = Signal[()]()
        gui, view = ui.client.gui, ui.workspace.view
        scope = next(name for name, kept in _SCOPES.items() if kept == view.live_agents)
        self._scope = gui.add_dropdown(
            "React live",
            tuple(_SCOPES),
            initial_value=scope,
            hint="Who follows while you drag or pull something (on or off: Shift+R)",
        )
        ui.on_change(self._scope, self._scope_chosen)

    @property
    def is_on(self) -> bool:
        """Whether traffic reacts during edits."""
        return self._ui.workspace.view.is_live

    def toggle(self) -> None:
        """Switch it on or off."""
        view = self._ui.workspace.view
        self._ui.workspace.view = replace(view, is_live=not view.is_live)
        self.switched.emit()

    def reacting_ids(self, scenario: Scenario) -> tuple[str, ...]:
        """Ids of the agents that react to an edit; empty if none does.

        Besides generated agents, those react whose trajectory guidance changes. An edit
        of the guidance of some agents is about these alone, as Regenerate in Guide is.
        """
        wanted = self._asked_ids(scenario)
        if not scenario.time_axis.num_future_steps:
            return ()
        kept = retimed_ids(self._ui.session.committed_scenario, scenario)
        names = None
        if wanted is not None or kept:
            there = [name for name in scenario.agents.ids if name not in kept]
            names = [name for name in there if wanted is None or name in wanted]
        if names == []:
            return ()
        try:
            return drivable_agent_ids(scenario, names)
        except GenerationError:
            return ()

    def silence(self, scenario: Scenario) -> str:
        """Why nothing reacts to edits, in few words; empty if something does."""
        if not self.is_on or self.reacting_ids(scenario):
            return ""
        why = "all are locked, or not there"
        if not scenario.time_axis.num_future_steps:
            why = "the scene has no future"
        elif self._asked_ids(scenario) == set():
            why = "no agent is generated or guided yet"
        return f"Nothing reacts live: {why}"

    def _asked_ids(self, scenario: Scenario) -> set[str] | None:
        """Ids of the agents that the user lets react; None for all."""
        if self._ui.workspace.view.live_agents == "all":
            return None
        wanted = self._guided_anew(scenario)
        if not wanted:
            wanted.update(generated_agent_ids(self._ui.session.commands_in_force))
            for term in scenario.guidance:
                wanted.update(term.guided_ids if term.is_on else ())
        return wanted

    def _guided_anew(self, scenario: Scenario) -> set[str]:
        """Agents of changed terms, if nothing else was edited; empty for terms of all."""
        before = self._ui.session.committed_scenario
        terms = [term for term in scenario.guidance if term not in before.guidance]
        is_other = (
            scenario.agents is not before.agents
            or scenario.road_map is not before.road_map
        )
        if is_other or not all(term.guided_ids for term in terms):
            return set()
        return {name for term in terms for name in term.guided_ids}

    def _scope_chosen(self, name: str) -> None:
        self._ui.workspace.view = replace(
            self._ui.workspace.view, live_agents=_SCOPES[name]
        )
        self.switched.emit()
