"""The guidance panel: tools to add terms, and the list of terms."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, Final

from msgspec import structs

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    Command,
    RemoveGuidance,
)
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.guidance.encounters import Encounters
from pd_editor.viewer.guidance.guidance_notes import GuidanceNotes, Line
from pd_editor.viewer.guidance.guiding import TOOLS, Guiding, replaced_index
from pd_editor.viewer.guidance.term_rows import (
    WEIGHTS,
    agents_of,
    chosen_point,
    has_handles,
    inputs_of,
    point_inputs,
    title_of,
    weight_stop,
    with_input,
    with_point_input,
    without_point,
)
from pd_editor.viewer.overlay.messages import (
    GuidanceInput,
    GuidancePanelEvent,
    GuidancePanelState,
    GuidanceRow,
    GuidanceTool,
    Note,
)
from pd_editor.viewer.tab.ui_context import UiContext

HOST: Final = '<div data-pd-host="guidance"></div>'
REMOVE_POINT: Final = "Remove way-point"
NEEDS_ONE: Final = "Select one agent first"


class GuidancePanel:
    """The terms of the selection, or all terms while nothing is selected.

    The page draws the list inside of viser's panel, since viser has no rows of inputs.
    """

    def __init__(
        self,
        ui: UiContext,
        guiding: Guiding,
        notes: GuidanceNotes,
        encounters: Encounters,
    ) -> None:
        """Build it into the current tab."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._guiding = guiding
        self._notes = notes
        self._encounters = encounters
        self._version = 0
        self._answered = 0
        """Number of the page's newest event, to which what is shown is the reply."""
        self._kinds: tuple[Any, ...] = ()
        ui.client.gui.add_html(HOST)
        self._overlay.on("guidance_panel", self._heard)
        self._model.agent_clicked.subscribe(self.leave_point)
        for signal in (
            self._model.shown,
            self._model.checked,
            self._model.run_changed,
            self._model.term_chosen,
            guiding.changed,
            encounters.changed,
        ):
            signal.subscribe(self.show)

    def show(self) -> None:
        """Follow the session."""
        session = self._ui.session
        scenario, selection = session.scenario, session.selection
        kinds = tuple((term.kind, term.named_ids) for term in scenario.guidance)
        if kinds != self._kinds:
            self._kinds = kinds
            self._version += 1
        chosen = self._model.chosen_term
        if chosen is not None and chosen >= len(kinds):
            self._model.choose_term(None)
            return
        self._guiding.follow()
        report = self._notes.report()
        state = GuidancePanelState(
            version=self._version,
            answered=self._answered,
            about=about_in_words(scenario, selection),
            weights=WEIGHTS,
            tools=tuple(self._tools(selection)),
            encounters=self._encounters.listed(),
            rows=tuple(
                self._row(index, scenario)
                for index in listed(scenario.guidance, selection)
            ),
            report=_noted(report.lines),
            figures=tuple(report.figures),
            action=report.action,
        )
        self._overlay.show(state)

    def _tools(self, selection: tuple[str, ...]) -> Iterator[GuidanceTool]:
        for kind, one in KINDS.items():
            is_enabled = one.tool is None or len(selection) == 1
            yield GuidanceTool(
                kind=kind,
                title=one.short,
                hint=one.hint if is_enabled else f"{NEEDS_ONE}. {one.hint}",
                is_active=self._guiding.tool == kind,
                is_enabled=is_enabled,
            )

    def _row(self, index: int, scenario: Scenario) -> GuidanceRow:
        term = scenario.guidance[index]
        title, agents = title_of(term), agents_of(term, scenario)
        return GuidanceRow(
            index=index,
            kind=term.kind,
            title=title,
            agents=agents,
            name=f"{title} of {agents}",
            is_on=term.is_on,
            is_chosen=index == self._model.chosen_term,
            stop=weight_stop(term.weight),
            inputs=tuple(
                structs.replace(one, notes=self._notes.of_options(index, one.name))
                for one in self._inputs(index, term)
            ),
            notes=_noted(self._notes.of_term(index)),
            action="" if self._point(index, term) is None else REMOVE_POINT,
        )

    def _inputs(self, index: int, term: GuidanceTerm) -> list[GuidanceInput]:
        if isinstance(term, FollowPath) and has_handles(term):
            chosen = self._point(index, term)
            return point_inputs(term, chosen, self._ui.session.scenario)
        return inputs_of(term)

    def _point(self, index: int, term: GuidanceTerm) -> int | None:
        """The chosen way-point of a term."""
        chosen = self._model.chosen_point
        if (
            index != self._model.chosen_term
            or not isinstance(term, FollowPath)
            or term.agent_id not in self._ui.session.selection
        ):
            return None
        return None if chosen is None or chosen >= len(term.points_m) else chosen

    def leave_point(self) -> bool:
        """Choose no way-point any more; False if none was chosen."""
        if self._model.chosen_point is None:
            return False
        self._model.choose_term(self._model.chosen_term)
        return True

    def remove_point(self) -> bool:
        """Remove the way-point that is chosen; False if none is."""
        index, terms = self._model.chosen_term, self._ui.session.scenario.guidance
        term = None if index is None or index >= len(terms) else terms[index]
        if index is None or not isinstance(term, FollowPath):
            return False
        point = self._point(index, term)
        if point is None:
            return False
        self._ui.apply(ChangeGuidance(index=index, term=without_point(term, point)))
        self._model.choose_term(index)
        return True

    def _heard(self, event: GuidancePanelEvent) -> None:
        """Act on an event of the list, and answer it even if it changes nothing."""
        self._answered = event.count
        try:
            self._act(event)
        finally:
            self.show()

    def _act(self, event: GuidancePanelEvent) -> None:
        """Act on an input of the list; one that was drawn for other terms is ignored."""
        kind = event.kind
        if kind == "tool":
            self._use_tool(event.tool)
        elif kind == "take":
            self._take_unguided()
        elif kind == "look":
            self._report_refused("What could happen", self._encounters.toggle)
        elif kind == "leave":
            self._encounters.close()
        elif kind == "point":
            self._encounters.point(event.number)
        elif kind == "make":
            self._encounters.make(event.number)
        elif event.version == self._version:
            index, terms = event.index, self._ui.session.scenario.guidance
            if 0 <= index < len(terms):
                self._edit(index, terms[index], event)

    def _use_tool(self, kind: str) -> None:
        """Begin to draw a term, or add one with usual values."""
        if kind in TOOLS:
            title = KINDS[kind].short
            self._report_refused(title, lambda: self._guiding.toggle(kind))
        elif kind in KINDS:
            self._guiding.stop()
            self._report_refused(KINDS[kind].title, lambda: self._add(kind))

    def _add(self, kind: str) -> None:
        """Add a term of a kind for the selection, or choose the one that is there."""
        session = self._ui.session
        term = KINDS[kind].usual_term(session.scenario, session.selection)
        index = replaced_index(session.scenario.guidance, term)
        if index is None:
            index = len(session.scenario.guidance)
            self._ui.apply(AddGuidance(term=term))
        self._model.choose_term(index)

    def _take_unguided(self) -> None:
        """Apply the unguided sample of the run that led to the present traffic."""
        session = self._ui.session
        run = self._ui.workspace.guided_runs.of(session.scenario.agents)
        command = None if run is None else run.unguided_command()
        if run is None or command is None:
            return
        self._ui.commit_gesture()
        if run.replaces_states:
            # Its agents are there already: the guided sample is taken back first.
            session.undo()
        self._ui.apply(command)

    def _edit(self, index: int, term: GuidanceTerm, event: GuidancePanelEvent) -> None:
        kind = event.kind
        if kind == "choose":
            self._select_agents(term)
            self._model.choose_term(index)
        elif kind == "switch":
            changed = replace(term, is_on=event.is_on)
            self._ui.apply(ChangeGuidance(index=index, term=changed))
        elif kind == "remove":
            self._ui.apply(RemoveGuidance(index=index))
        elif kind == "weight":
            self._weigh(index, term, event)
        elif kind == "act":
            self._report_refused(KINDS[term.kind].title, self.remove_point)
        elif kind == "input":
            name, value = event.name, event.value
            if name == "point" and isinstance(term, FollowPath):
                self._select_agents(term)
                self._model.choose_term(index, chosen_point(term, value))
                return
            self._report_refused(
                KINDS[term.kind].title, lambda: self._give(index, term, name, value)
            )

    def _give(self, index: int, term: GuidanceTerm, name: str, value: Any) -> None:
        """Set a value of a term, or of its chosen way-point."""
        point = self._point(index, term)
        if point is not None and isinstance(term, FollowPath):
            changed: GuidanceTerm = with_point_input(term, point, name, value)
        else:
            changed = with_input(term, name, value)
        self._ui.apply(ChangeGuidance(index=index, term=changed))

    def _weigh(self, index: int, term: GuidanceTerm, event: GuidancePanelEvent) -> None:
        """Set a strength; the moves of a slider until it is released are one edit."""
        if not 0 <= event.stop < len(WEIGHTS):
            return
        owner = f"guidance strength {index}"
        command: Command = ChangeGuidance(
            index=index, term=replace(term, weight=WEIGHTS[event.stop])
        )
        self._ui.preview(owner, command)
        if event.is_end and self._ui.gesture == owner:
            self._ui.end_gesture()

    def _select_agents(self, term: GuidanceTerm) -> None:
        session = self._ui.session
        ids = tuple(
            one for one in term.guided_ids if one in session.scenario.agents.ids
        )
        if ids and not set(ids) & set(session.selection):
            session.select(ids)

    def _report_refused(self, title: str, act: Callable[[], object]) -> None:
        """Do something; a refusal is told."""
        try:
            act()
        except PdEditorError as error:
            self._ui.notify(f"{title}: not set", str(error), "error")


def _noted(lines: Iterable[Line]) -> tuple[Note, ...]:
    return tuple(Note(tone=line.tone, text=line.text) for line in lines)


def listed(guidance: tuple[GuidanceTerm, ...], selection: tuple[str, ...]) -> list[int]:
    """Indices of the terms that concern the selection; of all without one."""
    return [
        index
        for index, term in enumerate(guidance)
        if not selection or not term.named_ids or set(term.named_ids) & set(selection)
    ]


def about_in_words(scenario: Scenario, selection: tuple[str, ...]) -> str:
    """The agents whose terms are listed, and which a new term guides."""
    count = len(scenario.guidance)
    if not selection:
        return (
            "Guidance of all agents. Select an agent to steer it."
            if not count
            else f"All {count} terms. A new one guides all agents."
            if count > 1
            else "One term. A new one guides all agents."
        )
    others = count - len(listed(scenario.guidance, selection))
    more = f"; {others} more of other agents" if others else ""
    if len(selection) == 1:
        row = scenario.agents.row_of.get(selection[0])
        kind = "agent" if row is None else str(scenario.agents.kinds[row])
        return f"Guidance of {kind.replace('_', ' ')} {selection[0]}{more}"
    return f"Guidance of {len(selection)} agents{more}"
