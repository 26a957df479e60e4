"""Steering by hand: the drawing mode, the marks on the road and the panel as one."""

from typing import Final

import numpy as np

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.speed import StopAtLine
from pd_editor.viewer.guidance.encounters import Encounters
from pd_editor.viewer.guidance.guidance_handles import GuidanceHandles
from pd_editor.viewer.guidance.guidance_notes import GuidanceNotes
from pd_editor.viewer.guidance.guiding import TOOLS, Guiding
from pd_editor.viewer.scene.picking import MenuItem
from pd_editor.viewer.tab.ui_context import UiContext

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
