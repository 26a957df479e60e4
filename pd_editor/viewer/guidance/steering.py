"""Steering by hand: the drawing mode, marks on the road to drag, and the panel as one."""

from dataclasses import dataclass
from itertools import count
from typing import Final

import numpy as np

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.kinds.speed import StopAtLine
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import AddGuidance, ChangeGuidance, Command
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.guidance.encounters import Encounters
from pd_editor.viewer.guidance.guidance_notes import GuidanceNotes
from pd_editor.viewer.guidance.guiding import TOOLS, Guiding, drawn, like
from pd_editor.viewer.guidance.term_marks import (
    OFFER,
    marks_of,
    offer_mark,
    offered_goal,
    round_bodies,
)
from pd_editor.viewer.guidance.term_rows import with_point_at
from pd_editor.viewer.overlay.messages import GuidanceMarksEvent, GuidanceMarksState
from pd_editor.viewer.scene.picking import MenuItem, point_of
from pd_editor.viewer.tab.ui_context import UiContext


@dataclass(kw_only=True, eq=False)
class _Grab:
    """A mark held by the pointer."""

    owner: str
    index: int
    scenario: Scenario
    """The scenario when the mark was taken; the drag's commands apply to it."""
    agent_id: str
    node: int | None = None
    """Place of the way-point, or of the one before a new one."""
    is_new: bool = False
    is_free: bool = False
    """Whether points do not snap to lanes."""
    has_moved: bool = False
    refusal: str = ""
    """Why the mark cannot be where the pointer is; empty if it can."""


class GuidanceHandles:
    """Shows where terms are, and follows drags of goals and stop lines."""

    def __init__(
        self, ui: UiContext, notes: GuidanceNotes, encounters: Encounters
    ) -> None:
        """Show nothing yet; encounters are drawn, pointed at and clicked as well."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._notes = notes
        self._encounters = encounters
        self._numbers = count()
        self._grab: _Grab | None = None
        self._overlay.on("guidance_marks", self._heard)
        self._model.poses_drawn.subscribe(self.show)
        self._model.sample_pointed.subscribe(self.show)
        self._model.term_chosen.subscribe(self.show)
        encounters.changed.subscribe(self.show)

    def show(self) -> None:
        """Put marks where their terms and agents are drawn; none beside another road."""
        poses, sample = self._model.poses, self._model.sample
        session = self._ui.session
        scenario, selection = session.scenario, session.selection
        if sample is not None and sample.applied_warp is not scenario.applied_warp:
            self._overlay.show(GuidanceMarksState(marks=(), agents=(), refusal=""))
        if poses is None or sample is not None:
            return
        notes, chosen = self._notes.sentences(), self._model.chosen_term
        point = self._model.chosen_point
        marks = marks_of(
            scenario, poses, selection, notes, chosen=chosen, chosen_point=point
        )
        playback = self._ui.workspace.playback
        offer = None if playback.is_playing else offered_goal(scenario, selection)
        marks += [offer_mark(scenario, poses, *offer)] if offer else []
        arcs = self._encounters.marks(scenario, poses)
        said = "" if self._grab is None else self._grab.refusal
        agents = round_bodies(scenario, poses) if arcs else ()
        state = GuidanceMarksState(marks=(*arcs, *marks), agents=agents, refusal=said)
        self._overlay.show(state)

    def _heard(self, event: GuidanceMarksEvent) -> None:
        """Follow one message of a press on a mark."""
        what, index = event.kind, event.index
        possible = self._encounters.made_of(index or 0)
        if what == "point":
            self._encounters.point(possible)
            return
        if what == "drop" and possible is not None:
            self._encounters.make(possible)
            return
        if what == "grab" and index is not None:
            self._grab = self._grabbed(index)
            if self._grab is not None:
                self._grab.node, self._grab.is_new = event.node, event.is_offer
            return
        grab = self._grab
        if grab is None:
            return
        point = point_of(event.point)
        grab.is_free = event.is_free
        if what == "drag" and point is not None:
            self._drag(grab, point)
        elif what == "drop":
            self._grab = None
            if point is None and not grab.has_moved:
                self._choose(grab)
            else:
                self._drop(grab, point)
        elif what == "cancel":
            self._grab = None
            if self._holds(grab):
                self._ui.abort_gesture()
        self.show()

    def _grabbed(self, index: int) -> _Grab | None:
        session = self._ui.session
        self._ui.commit_gesture()
        scenario = session.scenario
        if index == OFFER:
            offer = offered_goal(scenario, session.selection)
            agent_id = None if offer is None else offer[0]
        elif 0 <= index < len(scenario.guidance):
            agent_id = next(iter(scenario.guidance[index].guided_ids), "")
        else:
            agent_id = None
        if agent_id is None:
            return None
        if agent_id and agent_id not in session.selection:
            session.select((agent_id,))
        return _Grab(
            owner=f"guidance handle {next(self._numbers)}",
            index=index,
            scenario=scenario,
            agent_id=agent_id,
        )

    def _choose(self, grab: _Grab) -> None:
        """A click without a drag chooses the term or way-point, or makes a new one."""
        if grab.index == OFFER:
            return
        if grab.node is not None and grab.is_new:
            term = grab.scenario.guidance[grab.index]
            assert isinstance(term, FollowPath)
            ends = np.array(term.points_m[grab.node : grab.node + 2])
            self._drop(grab, ends.mean(axis=0))
        else:
            self._model.choose_term(grab.index, grab.node)

    def _drag(self, grab: _Grab, point_m: np.ndarray) -> None:
        if not self._holds(grab):
            self._grab = None
            return
        try:
            command = _command(grab, point_m)
            if command is not None:
                self._ui.preview(grab.owner, command)
                grab.has_moved = True
            grab.refusal = ""
        except PdEditorError as error:
            grab.refusal = str(error)

    def _drop(self, grab: _Grab, point_m: np.ndarray | None) -> None:
        """End the drag as one undo step; where the mark cannot be, nothing changes."""
        if point_m is not None:
            self._drag(grab, point_m)
        if grab.refusal:
            if self._ui.gesture == grab.owner:
                self._ui.abort_gesture()
            self._ui.notify("Not set", grab.refusal, "error")
        elif self._ui.gesture == grab.owner:
            self._ui.end_gesture()
            if grab.index == OFFER:
                self._model.choose_term(len(grab.scenario.guidance))
            elif grab.node is not None:
                self._model.choose_term(grab.index, grab.node + grab.is_new)

    def _holds(self, grab: _Grab) -> bool:
        """Whether nothing else has ended the drag or changed the scenario."""
        session = self._ui.session
        if not grab.has_moved:
            return session.scenario is grab.scenario
        return self._ui.gesture == grab.owner and session.state.is_previewing


def _command(grab: _Grab, point_m: np.ndarray) -> Command | None:
    """The command that moves the held mark to a point; None if it does not move."""
    scenario, points_m = grab.scenario, point_m[None]
    if grab.index == OFFER:
        return AddGuidance(term=GoalPoint.drawn(scenario, grab.agent_id, points_m))
    former = scenario.guidance[grab.index]
    if isinstance(former, FollowPath) and grab.node is not None:
        path = with_point_at(
            former,
            grab.node,
            point_m,
            scenario,
            is_new=grab.is_new,
            is_free=grab.is_free,
        )
        return ChangeGuidance(index=grab.index, term=path)
    if KINDS[former.kind].shape not in ("flag", "line"):
        return None
    term = drawn(former.kind, scenario, grab.agent_id, points_m)
    return ChangeGuidance(index=grab.index, term=like(term, former))


KEYS: Final = tuple(
    (kind, tool.label, tool.key) for kind, tool in TOOLS.items() if tool.key
)
"""Kinds of terms with the label and the hot key of their tool."""
LOOK: Final = "What could happen to it"


class Steering:
    """Guidance terms of one tab: how they are made, shown and changed."""

    def __init__(self, ui: UiContext) -> None:
        """Make mode and marks; the panel is built from them."""
        self._ui = ui
        self.mode = Guiding(ui)
        self.notes = GuidanceNotes(ui)
        self.encounters = Encounters(ui)
        self._handles = GuidanceHandles(ui, self.notes, self.encounters)
        ui.model.shown.subscribe(self._follow)
        ui.model.checked.subscribe(self._check)

    def add_hotkeys(self) -> None:
        """Register a key for each of the main tools, and commands for the others."""
        for kind, tool in TOOLS.items():
            title = KINDS[kind].short
            self._ui.hotkey(
                tool.label or f"Guidance: {title}",
                lambda kind=kind: self.mode.toggle(kind),
                tool.key,
                failure=f"{title}: not set",
                arms=True,
            )
        self._ui.hotkey(LOOK, self.encounters.toggle, "X", "shift")

    def _follow(self) -> None:
        """Follow the session, after the picture: terms are checked here."""
        if self.notes.refresh() | self.encounters.follow():
            self._handles.show()

    def _check(self) -> None:
        """Check all terms, in a pause between edits."""
        if self.notes.refresh(is_pause=True):
            self._handles.show()

    def agent_items(self, *, is_enabled: bool) -> tuple[MenuItem, ...]:
        """Items of the menu of the one selected agent."""
        tools = tuple(
            (label, lambda kind=kind: self.mode.toggle(kind), key)
            for kind, label, key in KEYS
        )
        return tuple(
            MenuItem(label, act, is_enabled=is_enabled, key=key)
            for label, act, key in (*tools, (LOOK, self.encounters.toggle, "Shift+X"))
        )

    def pair_items(self, agent_id: str, other_id: str) -> tuple[MenuItem, ...]:
        """Items of the menu of an agent, for the agent that was selected before."""
        return (
            MenuItem(
                f"Agent {agent_id} yields to it",
                lambda: self.mode.pair(YieldTo.kind, agent_id, other_id),
            ),
            MenuItem(
                f"Agent {agent_id} threatens it",
                lambda: self.mode.pair(Threaten.kind, agent_id, other_id),
            ),
        )

    def road_items(self, point_m: np.ndarray) -> tuple[MenuItem, ...]:
        """Items of the menu of the road, for the one selected agent."""
        selection = self._ui.session.selection
        if len(selection) != 1:
            return ()
        (agent_id,) = selection
        return (
            MenuItem(
                f"Drive agent {agent_id} here",
                lambda: self.mode.put(GoalPoint.kind, agent_id, point_m[None]),
            ),
            MenuItem(
                f"Stop agent {agent_id} here",
                lambda: self.mode.put(StopAtLine.kind, agent_id, point_m[None]),
            ),
        )
