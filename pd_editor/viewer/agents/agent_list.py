"""The list of all agents, over the picture's left side."""

from collections.abc import Collection, Iterable
from typing import Any, Final

import numpy as np

from pd_editor.scene.palette import Palette
from pd_editor.scene.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.viewer.agents.lock_controls import toggle_lock
from pd_editor.viewer.overlay.messages import (
    AgentRow,
    AgentSelectionState,
    AgentsEvent,
    AgentsState,
)
from pd_editor.viewer.tab.ui_context import UiContext

FOCAL: Final = 1
EGO: Final = 2
NEW: Final = 4
EDITED: Final = 8
LATER: Final = 16
GONE: Final = 32
PROBLEM: Final = 64
STALE: Final = 128
LOCKED: Final = 256

Ids = Collection[str]


class AgentList:
    """Searches, sorts, filters and selects agents; the page draws only rows in sight.

    Rows are sent while the list is open only, and not while a gesture is under way.
    """

    def __init__(self, ui: UiContext) -> None:
        """Start closed."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._number = 0
        self._listed: tuple[Any, ...] = ()
        self._ids: tuple[str, ...] = ()
        self.is_open = False
        self._overlay.on("agents", self._used)
        self._model.drawer_changed.subscribe(self._follow_drawer)
        self._model.shown.subscribe(self.show)
        self._model.checked.subscribe(self.show)

    def show(self) -> None:
        """Update the page's list."""
        session = self._ui.session
        if not self.is_open or (session.state.is_previewing and self._ids):
            return
        scenario, palette = session.scenario, self._model.palette
        problems, later = self._model.findings.problem_ids()
        listed = (
            scenario,
            session.original,
            frozenset(problems),
            frozenset(later),
            palette,
        )
        if not self._listed or any(
            one is not other and one != other
            for one, other in zip(listed, self._listed, strict=True)
        ):
            self._listed = listed
            self._number += 1
            self._ids = scenario.agents.ids
            kinds, rows = listed_agents(
                scenario,
                session.original,
                palette,
                problems=problems,
                stale=self._model.findings.stale_ids(),
            )
            state = AgentsState(
                is_open=True,
                number=self._number,
                focal=_css(palette.focal),
                ego=_css(palette.ego),
                kinds=kinds,
                rows=rows,
            )
            self._overlay.show(state)
        row_of = scenario.agents.row_of
        chosen = tuple(row_of[agent_id] for agent_id in session.selection)
        self._overlay.show(AgentSelectionState(number=self._number, rows=chosen))

    def _follow_drawer(self) -> None:
        is_open = self._model.drawer == "agents"
        if is_open == self.is_open:
            return
        self.is_open, self._listed = is_open, ()
        if is_open:
            self.show()
        else:
            self._overlay.show(AgentsState())
            self._model.point_at(None)

    def _used(self, event: AgentsEvent) -> None:
        kind = event.kind
        if kind == "open":
            self._model.open_drawer("agents")
        elif kind == "close":
            self._model.open_drawer(None)
        elif event.number != self._number or not self.is_open:
            return
        elif kind == "select":
            ids = self._named(event.rows)
            if len(ids) == 1 and self._model.agent_picked.offer(ids[0]):
                return
            self._ui.commit_gesture()
            self._ui.session.select(ids)
            if len(ids) == 1:
                self._model.agent_clicked.emit()
        elif kind == "lock":
            toggle_lock(self._ui)
        elif kind == "point":
            ids = () if event.row is None else self._named([event.row])
            self._model.point_at(ids[0] if ids else None)

    def _named(self, rows: Iterable[int]) -> tuple[str, ...]:
        """Ids of rows; what is no row is left out."""
        there = self._ui.session.scenario.agents.row_of
        count = len(self._ids)
        found = [self._ids[row] for row in rows if 0 <= row < count]
        return tuple(agent_id for agent_id in found if agent_id in there)


def listed_agents(
    scenario: Scenario, base: Scenario, palette: Palette, *, problems: Ids, stale: Ids
) -> tuple[tuple[tuple[str, str], ...], tuple[AgentRow, ...]]:
    """Kinds and rows of the list, as the page takes them.

    A row is id, place of the kind, speed and distance to the focal agent at the
    current step (None if it is not there), marks, and whether it moves.
    """
    agents, now = scenario.agents, scenario.current_step
    kinds = tuple(dict.fromkeys(agents.kinds))
    is_there = agents.is_valid[:, now]
    speed = np.hypot(*agents.velocity_mps[:, now].T).round(1)
    focal = agents.row_of.get(scenario.focal_id)
    has_focal = focal is not None and bool(is_there[focal])
    distance = np.zeros(len(agents))
    if has_focal:
        offset = agents.position_m[:, now] - agents.position_m[focal, now]
        distance = np.hypot(*offset.T).round(1)
    untouched = untouched_agent_ids(scenario, base)
    comes_later = agents.is_valid[:, now + 1 :].any(axis=1)
    marks = np.where(is_there, 0, np.where(comes_later, LATER, GONE))
    known = base.agents.row_of
    place = {kind: index for index, kind in enumerate(kinds)}
    rows: list[AgentRow] = []
    for row, agent_id in enumerate(agents.ids):
        mark = int(marks[row])
        mark |= FOCAL * (agent_id == scenario.focal_id) | EGO * (agent_id == EGO_ID)
        mark |= LOCKED * (agent_id in scenario.locks)
        mark |= PROBLEM * (agent_id in problems) | STALE * (agent_id in stale)
        if agent_id not in known:
            mark |= NEW
        elif agent_id not in untouched:
            mark |= EDITED
        there = bool(is_there[row])
        rows.append(
            (
                agent_id,
                place[agents.kinds[row]],
                float(speed[row]) if there else None,
                float(distance[row]) if there and has_focal else None,
                mark,
                there and bool(speed[row] >= STANDING_MPS),
            )
        )
    named = tuple((kind.in_words, _css(palette.kinds[kind])) for kind in kinds)
    return named, tuple(rows)


def _css(color: tuple[int, int, int]) -> str:
    return f"rgb{color}"
