"""The list of all agents, over the picture's left side."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np

from pd_editor.editor.commands.carried_trajectories import carried_agent_ids
from pd_editor.scene.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.viewer.meshes.palette import DARK, LIGHT, Palette
from pd_editor.viewer.overlay.messages import AgentRow, AgentSelectionState, AgentsState
from pd_editor.viewer.overlay.overlay import Overlay
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

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        *,
        problems: Callable[[], tuple[Ids, Ids]],
        on_pointed: Callable[[str | None], None],
        on_opened: Callable[[], None],
        on_lock: Callable[[], None],
        picked: Callable[[str], bool],
    ) -> None:
        """Start closed.

        ``problems`` are agents with a problem at any time, and those with one later;
        ``on_pointed`` is called with the agent whose row is under the pointer, or None;
        ``picked`` takes a single chosen agent if a mode asks for one, and says so.
        """
        self._ui = ui
        self._overlay = overlay
        self._problems = problems
        self._on_pointed = on_pointed
        self._on_opened = on_opened
        self._on_lock = on_lock
        self._picked = picked
        self._number = 0
        self._listed: tuple[Any, ...] = ()
        self._ids: tuple[str, ...] = ()
        self.is_open = False
        overlay.on("agents", self._used)

    def toggle(self) -> None:
        """Open the list, or close it."""
        self._set_open(not self.is_open)

    def stale_ids(self) -> frozenset[str]:
        """Agents whose trajectory was moved by an edit and no longer fits the road."""
        carried = carried_agent_ids(self._ui.session.commands_in_force)
        return carried & frozenset(self._problems()[1]) if carried else carried

    def show(self) -> None:
        """Update the page's list."""
        session = self._ui.session
        if not self.is_open or (session.state.is_previewing and self._ids):
            return
        scenario, (problems, later) = session.scenario, self._problems()
        palette = DARK if self._ui.workspace.is_dark else LIGHT
        listed = (
            scenario,
            session.base,
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
                session.base,
                palette,
                problems=problems,
                stale=self.stale_ids(),
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

    def _set_open(self, is_open: bool) -> None:
        self.is_open = is_open
        self._listed = ()
        if is_open:
            self.show()
        else:
            self._overlay.show(AgentsState())
            self._on_pointed(None)
        self._on_opened()

    def _used(self, event: Mapping[str, Any]) -> None:
        kind = event.get("kind")
        if kind in ("open", "close"):
            self._set_open(kind == "open")
        elif event.get("number") != self._number or not self.is_open:
            return
        elif kind == "select":
            ids = self._named(event.get("rows"))
            if len(ids) == 1 and self._picked(ids[0]):
                return
            self._ui.commit_gesture()
            self._ui.session.select(ids)
        elif kind == "lock":
            self._on_lock()
        elif kind == "point":
            ids = self._named([event.get("row")])
            self._on_pointed(ids[0] if ids else None)

    def _named(self, rows: Any) -> tuple[str, ...]:
        """Ids of rows; what is no row is left out."""
        if not isinstance(rows, list):
            return ()
        there = self._ui.session.scenario.agents.row_of
        count = len(self._ids)
        found = [
            self._ids[row] for row in rows if type(row) is int and 0 <= row < count
        ]
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
