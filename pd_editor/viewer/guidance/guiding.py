"""The mode in which a guidance term is drawn on the road or an agent is picked for it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.base.errors import EditError, PdEditorError
from pd_editor.editor.commands import AddGuidance, ChangeGuidance
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, ROAD_USER_KINDS
from pd_editor.scene.guidance_terms import GuidanceTerm, PairGuidance, forms_of
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import (
    GuidingEvent,
    GuidingGhost,
    GuidingState,
    rounded_place,
)
from pd_editor.viewer.scene.picking import PointerRay, agent_under, point_of
from pd_editor.viewer.tab.mode import Mode
from pd_editor.viewer.tab.ui_context import UiContext

MAX_DRAWN_POINTS: Final = 2_000
ONE_AGENT: Final = "Select one agent first; its guidance is drawn on the road."


TOOLS: Final = {kind: one.tool for kind, one in KINDS.items() if one.tool is not None}
"""Kinds of terms that are drawn or picked on the picture."""


class Guiding(Mode):
    """Mode for one term of one agent; it ends with the term, or with Escape."""

    name = "guiding"
    button = "Cancel (Esc)"

    def __init__(self, ui: UiContext) -> None:
        """Make the mode, switched off; an agent is picked among those in the picture."""
        super().__init__(ui)
        self._ghost = GuidingGhost()
        self.tool: str | None = None
        """Kind of the term that is drawn; None while the mode is off."""
        self.agent_id = ""
        ui.model.scene_left.subscribe(self.stop)
        ui.model.agent_picked.subscribe(self.pick)

    def toggle(self, kind: str) -> None:
        """Begin to draw a term of the selected agent, or stop.

        Raises:
            EditError: not one agent is selected, or it cannot be guided.
        """
        if self.tool == kind:
            self.stop()
            return
        agent_id = one_guided(self._ui.session.scenario, self._ui.session.selection)
        self._ui.commit_gesture()
        self._ui.show_current_step()
        self.tool, self.agent_id, self._ghost = kind, agent_id, GuidingGhost()
        self._set_active(True)

    def stop(self) -> None:
        """End the mode, if it is active; nothing else changes."""
        if self.is_active:
            self.tool, self._ghost = None, GuidingGhost()
            super().stop()

    def follow(self) -> None:
        """End the mode if its agent is gone, after an undo for example."""
        if self.is_active and self.agent_id not in self._ui.session.scenario.agents.ids:
            self.stop()

    def put(self, kind: str, agent_id: str, points_m: Any = ()) -> None:
        """Let an agent have a term of a kind, which is drawn at points of the road.

        Raises:
            EditError: it cannot be there.
        """
        self._put(drawn(kind, self._ui.session.scenario, agent_id, points_m))

    def pair(self, kind: str, agent_id: str, other_id: str) -> None:
        """Let an agent yield to another one, or threaten it."""
        self._put(KINDS[kind].value(agent_id=agent_id, other_id=other_id))

    def pick(self, agent_id: str) -> bool:
        """Take an agent that was chosen elsewhere than in the picture, such as in a list.

        False if the mode asks for none.
        """
        kind = self.tool
        if kind is None or TOOLS[kind].gesture != "pick":
            return False
        self._finish(lambda: self._pair_with(agent_id))
        return True

    def _pair_with(self, other_id: str) -> GuidanceTerm:
        if other_id == self.agent_id:
            raise EditError(f"That is {other_id} itself; choose another agent.")
        kind = KINDS[str(self.tool)]
        return kind.value(agent_id=self.agent_id, other_id=other_id)

    def _put(self, term: GuidanceTerm) -> None:
        """Add a term, or replace the agent's term of the same kind."""
        guidance = self._ui.session.scenario.guidance
        index = replaced_index(guidance, term)
        if index is None:
            self._ui.apply(AddGuidance(term=term))
            index = len(guidance)
        else:
            self._ui.apply(
                ChangeGuidance(index=index, term=like(term, guidance[index]))
            )
        self._model.choose_term(index)

    def _sentence(self) -> str:
        agents = self._ui.session.scenario.agents
        kind = agents.kinds[agents.row_of[self.agent_id]].in_words
        tool = str(self.tool)
        return f"{KINDS[tool].short}: {kind} {self.agent_id}: {TOOLS[tool].banner}"

    def _show(self) -> None:
        """Send the mode and what the pointer would do."""
        if self.tool is None:
            self._overlay.show(GuidingState())
            return
        agents = self._ui.session.scenario.agents
        row, step = agents.row_of[self.agent_id], agents.num_steps - 1
        step = min(step, self._ui.session.scenario.current_step)
        height = DEFAULT_HEIGHT_M[agents.kinds[row]] / 2
        state = GuidingState(
            is_active=True,
            kind=self.tool,
            gesture=TOOLS[self.tool].gesture,
            start=rounded_place((*agents.position_m[row, step], height)),
            ghost=self._ghost,
        )
        self._overlay.show(state)

    def _heard(self, event: GuidingEvent) -> None:
        """Handle a pointer event; late events of another mode are ignored."""
        if self.tool is None or event.tool != self.tool:
            return
        what, ray = event.kind, PointerRay.of(event.at, event.ray)
        if what == "point" and ray is not None:
            self._ghost = self._ghost_at(ray)
            self._show()
        elif what == "click" and ray is not None:
            self._finish(lambda: self._clicked(ray))
        elif what == "drawn":
            found = map(point_of, event.points[:MAX_DRAWN_POINTS])
            points = np.array([one for one in found if one is not None]).reshape(-1, 2)
            self._finish(lambda: self._drawn(points, is_clicked=event.is_clicked))

    def _finish(self, make: Callable[[], GuidanceTerm]) -> None:
        """Put the term and end the mode; a refused one leaves the mode on."""
        assert self.tool is not None
        title = KINDS[self.tool].short
        try:
            self._put(make())
        except PdEditorError as error:
            self._ui.notify(f"{title}: not set", str(error), "error")
            return
        self.stop()

    def _clicked(self, ray: PointerRay) -> GuidanceTerm:
        """The term of a click."""
        if TOOLS[str(self.tool)].gesture == "pick":
            other = self._picked(ray)
            if other is None:
                raise EditError("No other agent is there; click one.")
            return self._pair_with(other)
        if ray.ground_m is None:
            raise EditError("That is the sky; click the road.")
        return self._drawn(ray.ground_m[None])

    def _drawn(self, points_m: np.ndarray, *, is_clicked: bool = False) -> GuidanceTerm:
        scenario, tool = self._ui.session.scenario, TOOLS[str(self.tool)]
        if is_clicked and tool.click is not None and len(points_m) > 1:
            return tool.click(scenario, self.agent_id, points_m)
        return drawn(str(self.tool), scenario, self.agent_id, points_m)

    def _picked(self, ray: PointerRay) -> str | None:
        """The other agent under the pointer."""
        poses, agents = self._model.poses, self._ui.session.scenario.agents
        row = None if poses is None else agent_under(agents, poses, ray)
        if row is None or agents.ids[row] == self.agent_id:
            return None
        return agents.ids[row]

    def _ghost_at(self, ray: PointerRay) -> GuidingGhost:
        """What a click at the pointer would do, for the page."""
        scenario = self._ui.session.scenario
        if TOOLS[str(self.tool)].gesture == "pick" and self._picked(ray) is None:
            return GuidingGhost()
        try:
            term = self._clicked(ray)
        except PdEditorError as error:
            return GuidingGhost(text=str(error), is_bad=True)
        if isinstance(term, PairGuidance):
            poses = self._model.poses
            assert poses is not None
            row = scenario.agents.row_of[term.other_id]
            kind = scenario.agents.kinds[row].in_words
            height = DEFAULT_HEIGHT_M[scenario.agents.kinds[row]] / 2
            end = rounded_place((*poses.position_m[row], height))
            return GuidingGhost(text=f"{kind} {term.other_id}", end=end)
        kind = KINDS[term.kind]
        if kind.points_m is None or kind.shape == "flag":
            return GuidingGhost()
        points = np.round(kind.points_m(term, scenario), 2).tolist()
        return GuidingGhost(points=tuple((x, y) for x, y in points))


def drawn(
    kind: str, scenario: Scenario, agent_id: str, points_m: np.ndarray
) -> GuidanceTerm:
    """Term of a kind that is drawn at points of the road.

    Raises:
        EditError: it cannot be there.
    """
    draw = TOOLS[kind].draw
    assert draw is not None, f"{kind} is not drawn"
    return draw(scenario, agent_id, points_m)


def one_guided(scenario: Scenario, selection: tuple[str, ...]) -> str:
    """Id of the one selected agent.

    Raises:
        EditError: not one is selected, or it is no road user that is there at t = 0.
    """
    if len(selection) != 1:
        raise EditError(ONE_AGENT)
    (agent_id,) = selection
    agents = scenario.agents
    (row,) = agents.rows([agent_id])
    if not agents.is_valid[row, scenario.current_step]:
        raise EditError(f"Agent {agent_id} is not there at t = 0.")
    if agents.kinds[row] not in ROAD_USER_KINDS:
        kind = agents.kinds[row].in_words
        raise EditError(f"Agent {agent_id} is a {kind} object; it cannot be guided.")
    return agent_id


def replaced_index(
    guidance: tuple[GuidanceTerm, ...], term: GuidanceTerm
) -> int | None:
    """Index of the term that a new one replaces; None if there is none."""
    places = [other.place for other in guidance]
    return places.index(term.place) if term.place in places else None


def like(term: GuidanceTerm, former: GuidanceTerm) -> GuidanceTerm:
    """A new term with strength and values of the term that it replaces."""
    same = {name: getattr(former, name) for name in forms_of(type(term))}
    return replace(term, weight=former.weight, is_on=True, **same)
