"""Handles of times on the timeline: of goals, way-points and locked beginnings."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import ChangeGuidance, Command, SetLocks
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.locks import Lock
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import (
    TimeHandle,
    TimeHandlesEvent,
    TimeHandlesState,
)
from pd_editor.viewer.tab.ui_context import UiContext

LOCK: Final = "lock"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Handle:
    """What a time is of, and the command that changes it."""

    kind: str
    time_s: float
    words: str
    command: Callable[[float], Command]
    term: int | None = None


class TimeHandles:
    """The element ``timeHandles``: times of the selection's terms and locks.

    A drag is a gesture; a click chooses the term.
    """

    def __init__(self, ui: UiContext) -> None:
        """Show them above the track of the timeline."""
        self._ui = ui
        self._numbers = count()
        self._owner = ""
        self._held: _Handle | None = None
        self._refusal = ""
        ui.overlay.on("timeHandles", self._heard)
        ui.model.shown.subscribe(self.show)
        ui.model.term_chosen.subscribe(self.show)

    def show(self) -> None:
        """Follow scenario and selection."""
        scenario, step_s = self._scenario, self._scenario.time_axis.step_s
        handles = tuple(
            TimeHandle(
                kind=one.kind,
                step=round(one.time_s / step_s),
                text=one.words,
                is_chosen=one.term is not None
                and one.term == self._ui.model.chosen_term,
            )
            for one in _handles(scenario, self._ui.session.selection)
        )
        self._ui.overlay.show(TimeHandlesState(handles=handles))

    @property
    def _scenario(self) -> Scenario:
        return self._ui.session.scenario

    def _heard(self, event: TimeHandlesEvent) -> None:
        """Follow a press on a handle; times beyond the trajectories are refused."""
        what, index, step = event.kind, event.index, event.step
        if what == "grab":
            found = _handles(self._scenario, self._ui.session.selection)
            self._held = found[index] if 0 <= index < len(found) else None
            self._owner = f"time handle {next(self._numbers)}"
            self._refusal = ""
            return
        held = self._held
        if held is None:
            return
        if step is not None:
            self._move(held, step)
        if what in ("drop", "cancel"):
            self._held = None
            self._end(held, is_dropped=what == "drop")

    def _move(self, held: _Handle, step: int) -> None:
        """Show the time at a step; one that cannot be is not shown."""
        axis = self._scenario.time_axis
        step = min(max(step, 1), axis.num_future_steps)
        try:
            time_s = round(step * axis.step_s, 3)
            self._ui.preview(self._owner, held.command(time_s))
            self._refusal = ""
        except PdEditorError as error:
            self._refusal = str(error)

    def _end(self, held: _Handle, *, is_dropped: bool) -> None:
        is_moved = self._ui.gesture == self._owner
        if is_dropped and self._refusal:
            self._ui.notify("Time: not set", self._refusal, "error")
        if is_moved and is_dropped:
            self._ui.end_gesture()
        elif is_moved:
            self._ui.abort_gesture()
        elif is_dropped and held.term is not None:
            self._ui.model.choose_term(held.term)


def _handles(scenario: Scenario, selection: tuple[str, ...]) -> list[_Handle]:
    """Times of the agents that are selected, in an order that drags do not change."""
    found: list[_Handle] = []
    for index, term in enumerate(scenario.guidance):
        if set(term.guided_ids) & set(selection):
            found += _of_term(index, term, scenario)
    for agent_id in selection:
        lock = scenario.locks.get(agent_id)
        if lock is not None and lock.kept_s:
            found.append(
                _Handle(
                    kind=LOCK,
                    time_s=lock.kept_s,
                    words=f"{agent_id} is locked for {lock.kept_s:g} s",
                    command=lambda time_s, name=agent_id: SetLocks(
                        agent_ids=(name,), lock=Lock(kept_s=time_s)
                    ),
                )
            )
    return found


def _of_term(index: int, term: GuidanceTerm, scenario: Scenario) -> list[_Handle]:
    """Times of a goal, or of the way-points of a path."""
    axis = scenario.time_axis
    end_s = axis.future_s
    if isinstance(term, GoalPoint):
        at_s = end_s if term.at_s is None else term.at_s
        return [
            _Handle(
                kind=term.kind,
                time_s=at_s,
                words=f"Goal of {term.agent_id} at {at_s:.1f} s",
                command=lambda time_s: ChangeGuidance(
                    index=index,
                    # At the end, as a goal without a time.
                    term=replace(term, at_s=time_s if time_s < end_s else None),
                ),
                term=index,
            )
        ]
    if not isinstance(term, FollowPath):
        return []

    def at(place: int, time_s: float) -> ChangeGuidance:
        points = term.way_points()
        points[place] = replace(points[place], at_s=time_s)
        return ChangeGuidance(index=index, term=term.with_way_points(points))

    return [
        _Handle(
            kind=term.kind,
            time_s=one.at_s,
            words=f"Way-point {one.number} of {term.agent_id} at {one.at_s:.1f} s",
            command=lambda time_s, place=place: at(place, time_s),
            term=index,
        )
        for place, one in enumerate(term.way_points())
        if one.at_s is not None
    ]
