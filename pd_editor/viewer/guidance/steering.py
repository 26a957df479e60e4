"""Steering by hand: the drawing mode, the marks on the road and the panel as one."""

from collections.abc import Callable
from typing import Final

import numpy as np

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.speed import StopAtLine
from pd_editor.viewer.guidance.encounters import Encounters
from pd_editor.viewer.guidance.guidance_handles import GuidanceHandles
from pd_editor.viewer.guidance.guidance_notes import GuidanceNotes
from pd_editor.viewer.guidance.guidance_panel import GuidanceActions, GuidancePanel
from pd_editor.viewer.guidance.guiding import TOOLS, Guiding
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.overlay.banner import Banner
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.context_menu import MenuItem
from pd_editor.viewer.tab.ui_context import UiContext

KEYS: Final = tuple(
    (kind, tool.label, tool.key) for kind, tool in TOOLS.items() if tool.key
)
"""Kinds of terms with the label and the hot key of their tool."""
LOOK: Final = "What could happen to it"


class Steering:
    """Guidance terms of one tab: how they are made, shown and changed."""

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        banner: Banner,
        poses: Callable[[], AgentPoses | None],
    ) -> None:
        """Make mode and marks; ``build_panel`` adds the panel."""
        self._ui = ui
        self._overlay = overlay
        self.mode = Guiding(ui, overlay, banner, poses)
        self._notes = GuidanceNotes(ui)
        self.encounters = Encounters(ui, self._choose, self._show_again)
        self._handles = GuidanceHandles(
            ui, overlay, self._notes.sentences, self._choose, self.encounters
        )
        self._panel: GuidancePanel | None = None
        self.mode.on_term = self._choose

    def build_panel(
        self,
        *,
        regenerate: Callable[[tuple[str, ...] | None], None],
        is_running: Callable[[], bool],
    ) -> None:
        """Build the panel into the current tab; None regenerates all agents."""
        self._panel = GuidancePanel(
            self._ui,
            self._overlay,
            self.mode,
            self._notes,
            GuidanceActions(
                regenerate=regenerate,
                is_running=is_running,
                take_unguided=self.take_unguided,
            ),
            self.encounters,
            self._chosen,
        )

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

    def show(self) -> None:
        """Follow the session, after the picture: terms are checked here."""
        if self._notes.refresh() | self.encounters.follow():
            self._handles.show_again()
        if self._panel is not None:
            self._panel.show()

    def check(self) -> None:
        """Check all terms, in a pause between edits."""
        if self._notes.refresh(is_pause=True):
            self.show()
            self._handles.show_again()

    def show_marks(self, poses: AgentPoses) -> None:
        """Put the marks where terms and agents are drawn."""
        self._handles.show(poses)

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

    def take_unguided(self) -> None:
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

    def _show_again(self) -> None:
        """Show a change of the possible encounters."""
        self._handles.show_again()
        if self._panel is not None:
            self._panel.show()

    def _choose(self, index: int) -> None:
        if self._panel is not None:
            self._panel.choose(index)

    def _chosen(self, index: int | None) -> None:
        self._handles.chosen = index
        self._handles.show_again()
