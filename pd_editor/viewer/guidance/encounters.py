"""What could happen to an agent: looked for in the background, listed and drawn."""

from collections.abc import Callable
from typing import Any, Final

from msgspec import structs

from pd_editor.analysis.guidance.possible_encounters import (
    PossibleEncounter,
    endangered_id,
    possible_encounters,
)
from pd_editor.base.errors import EditError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.commands import AddGuidance, ChangeGuidance
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.guidance.guiding import replaced_index
from pd_editor.viewer.guidance.term_marks import arc_mark
from pd_editor.viewer.guidance.term_rows import agents_of
from pd_editor.viewer.meshes.agent_shapes import AgentPoses
from pd_editor.viewer.overlay.messages import EncounterLine, EncounterList, GuidanceMark
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.tab.ui_context import UiContext

_POSSIBLE: Final = -2
"""Index of the first possible encounter among the marks, downwards; no terms yet."""


class EncounterSearch(BackgroundJob[tuple[PossibleEncounter, ...]]):
    """One search for what could happen to an agent."""

    def __init__(
        self,
        scenario: Scenario,
        agent_id: str,
        on_done: Callable[[tuple[PossibleEncounter, ...]], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Prepare the search; ``start`` starts it."""
        super().__init__(
            "possible encounters",
            lambda job: possible_encounters(scenario, agent_id, job.is_cancelled),
            on_done,
            on_error,
            subject="The search for what could happen",
        )
        self.scenario = scenario


class Encounters:
    """Possible encounters of one agent: none are shown until they are asked for."""

    def __init__(self, ui: UiContext) -> None:
        """Look for nothing yet."""
        self._ui = ui
        self.changed = Signal[()]()
        """Other encounters are known, or one is pointed at."""
        self._search: EncounterSearch | None = None
        self._agent_id: str | None = None
        self._base = ui.session.base
        self._found: tuple[PossibleEncounter, ...] | None = None
        self._pointed: int | None = None

    def toggle(self) -> None:
        """Look for what could happen to the selected agent or the ego, or close the list.

        Raises:
            EditError: neither is there.
        """
        if self._agent_id is None and self._wanted is None:
            raise EditError("Select an agent that is there at t = 0.")
        self._look(self._wanted if self._agent_id is None else None)
        self.changed.emit()

    def close(self) -> bool:
        """Close the list; returns whether it was open."""
        if self._agent_id is None:
            return False
        self.toggle()
        return True

    def follow(self) -> bool:
        """After an edit of agents or roads, look again when it is over.

        Returns whether what was found holds no longer.
        """
        state = self._ui.session.state
        is_other, self._base = self._base is not state.base, state.base
        if self._search is None or self._is_of(self._search.scenario):
            return False
        self._search.cancel()
        self._found, self._pointed = None, None
        if not state.is_previewing:
            row = state.scenario.agents.row_of.get(self._agent_id or "")
            now = state.scenario.current_step
            is_there = row is not None and state.scenario.agents.is_valid[row, now]
            self._look(self._agent_id if is_there and not is_other else None)
        return True

    def point(self, index: Any) -> None:
        """Preview an encounter: the arc and the way of the agent stand out.

        None, or what the page may send else: no encounter is pointed at.
        """
        number = None if self._at(index) is None else index
        if number != self._pointed:
            self._pointed = number
            self.changed.emit()

    def make(self, index: Any) -> None:
        """Make the term of an encounter, as one edit; one that is made is chosen."""
        one, guidance = self._at(index), self._ui.session.scenario.guidance
        if one is None:
            return
        if one.term not in guidance:
            place = replaced_index(guidance, one.term)
            self._ui.apply(
                AddGuidance(term=one.term)
                if place is None
                else ChangeGuidance(index=place, term=one.term)
            )
        self._ui.model.choose_term(self._ui.session.scenario.guidance.index(one.term))

    def made_of(self, mark: int) -> int | None:
        """Number of the encounter that a mark stands for."""
        return _POSSIBLE - mark if mark <= _POSSIBLE else None

    def marks(self, scenario: Scenario, poses: AgentPoses) -> list[GuidanceMark]:
        """An arc for each agent that could threaten, and for each that could yield."""
        arcs: dict[tuple[str, ...], GuidanceMark] = {}
        for number, one in enumerate(self._found or ()):
            key, is_pointed = (
                (one.term.kind, *one.term.named_ids),
                number == self._pointed,
            )
            words = f"{_guided(one, scenario)} {one.in_words}"
            arc = arcs.get(key)
            if arc is None:
                arc = arc_mark(scenario, poses, one.term, _POSSIBLE - number)
                if arc is None or one.term in scenario.guidance:
                    continue
            arc = structs.replace(arc, lines=(*arc.lines, words))
            if is_pointed:
                way = one.way_m[:: max(len(one.way_m) // 20, 1)].round(2).tolist()
                points = tuple((x, y) for x, y in way)
                arc = structs.replace(arc, is_chosen=True, points=points)
            arcs[key] = arc
        return list(arcs.values())

    def listed(self) -> EncounterList:
        """The button and the list, for the page."""
        scenario, agent_id = self._ui.session.scenario, self._agent_id or self._wanted
        found = self._found or ()
        if self._agent_id is None:
            about = ""
        elif self._found is None:
            about = "Looking ..."
        elif not found:
            about = f"Nothing, within the limits, to {_named(self._agent_id)}."
        else:
            about = (
                f"{len(found)} to {_named(self._agent_id)}. Point to preview, click."
            )
        return EncounterList(
            label=f"What could happen to {_named(agent_id or EGO_ID)}?",
            is_enabled=agent_id is not None,
            is_open=self._agent_id is not None,
            about=about,
            items=tuple(
                EncounterLine(
                    kind=one.term.kind,
                    agent=_guided(one, scenario),
                    text=one.in_words,
                    is_made=one.term in scenario.guidance,
                    is_pointed=number == self._pointed,
                )
                for number, one in enumerate(found)
            ),
        )

    @property
    def _wanted(self) -> str | None:
        session = self._ui.session
        return endangered_id(session.scenario, session.selection)

    def _at(self, index: Any) -> PossibleEncounter | None:
        found = self._found or ()
        is_one = isinstance(index, int) and 0 <= index < len(found)
        return found[index] if is_one else None

    def _is_of(self, scenario: Scenario) -> bool:
        """Whether the session differs by guidance alone."""
        mine = self._ui.session.scenario
        names = ("road_map", "agents", "locks")
        return all(getattr(mine, one) is getattr(scenario, one) for one in names)

    def _look(self, agent_id: str | None) -> None:
        if self._search is not None:
            self._search.cancel()
        self._search, self._agent_id = None, agent_id
        self._found, self._pointed = None, None
        if agent_id is None:
            return
        search = EncounterSearch(
            self._ui.session.scenario,
            agent_id,
            lambda found: self._ui.post(lambda: self._show(search, found)),
            lambda error: self._ui.post(lambda: self._fail(search, error)),
        )
        self._search = search
        search.start()

    def _show(
        self, search: EncounterSearch, found: tuple[PossibleEncounter, ...]
    ) -> None:
        if search is self._search and self._is_of(search.scenario):
            self._found = found
            self.changed.emit()

    def _fail(self, search: EncounterSearch, error: PdEditorError) -> None:
        if search is self._search:
            self._look(None)
            self._ui.notify("Not found", str(error), "error")
            self.changed.emit()


def _named(agent_id: str) -> str:
    return "the ego" if agent_id == EGO_ID else f"agent {agent_id}"


def _guided(one: PossibleEncounter, scenario: Scenario) -> str:
    is_ego = one.term.agent_id == EGO_ID
    return "The ego" if is_ego else agents_of(one.term, scenario).capitalize()
