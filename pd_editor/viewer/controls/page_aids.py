"""What the page's script looks after: viser's panel, the order of presses, hints."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import msgspec

from pd_editor.editor.commands import ReplaceTraffic, TransformAgents
from pd_editor.editor.commands.command import Command, parts_of
from pd_editor.viewer.overlay.messages import (
    HintsDone,
    HintsState,
    OrderEvent,
    OrderState,
    PanelEvent,
    PanelState,
)
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.tab.ui_context import UiContext


class Hints:
    """One small card over the picture; the browser remembers what was done."""

    def __init__(self, ui: UiContext) -> None:
        """Show nothing yet."""
        self._ui = ui
        ui.model.shown.subscribe(self.show)

    def show(self) -> None:
        """Send which hints the session has fulfilled, and whether there is no agent."""
        session = self._ui.session
        commands = parts_of((one.command for one in session.entries), Command)
        done = HintsDone(
            select=bool(session.selection),
            drag=any(isinstance(one, TransformAgents) for one in commands),
            bend=session.scenario.applied_warp is not None,
            regenerate=any(isinstance(one, ReplaceTraffic) for one in commands),
        )
        is_empty = not len(session.scenario.agents)
        self._ui.overlay.show(HintsState(is_empty=is_empty, done=done))


class PressOrder:
    """Answers the page when a button or key that may arm a mode has been processed.

    A press on the picture that the user makes meanwhile waits in the page, so that it is
    the mode's even over a slow connection.
    """

    def __init__(
        self, overlay: Overlay, *, keys: Sequence[str], labels: Sequence[str]
    ) -> None:
        """Tell the page which keys, and which buttons of the panel, may arm a mode."""
        self._overlay = overlay
        self._arming = tuple(keys), tuple(labels)
        overlay.on("order", self._heard)
        self._answer(0)

    def _heard(self, event: OrderEvent) -> None:
        self._answer(event.number)

    def _answer(self, number: int) -> None:
        keys, labels = self._arming
        self._overlay.show(OrderState(keys=keys, labels=labels, answered=number))


SCENE: Final = "Scene"
ROAD: Final = "Road"
AGENTS: Final = "Agents"
STUDY: Final = "Study"


class SidePanel:
    """Keeps the tab that is open, and opens it again after a reload.

    It shows an agent that is clicked in the place of what says nothing of agents, and
    that again once nothing is selected.

    It also tells when the pointer takes a slider and lets it go, which viser does not;
    without the page's script a slider's gesture is over when it rests.
    """

    def __init__(self, ui: UiContext, *, is_debug: bool) -> None:
        """Open the tab that was open; viser's own settings are offered to debug only."""
        self._ui = ui
        self._overlay = ui.overlay
        self._state = PanelState(tab=ui.workspace.view.panel_tab, is_debug=is_debug)
        self._overlay.on("panel", self._heard)
        self._overlay.show(self._state)
        self._left: str | None = None
        """The tab in whose place the selection is shown."""
        ui.model.agent_clicked.subscribe(self._agent_clicked)
        ui.model.shown.subscribe(self._return)
        ui.model.tab_asked.subscribe(self._asked)

    def _agent_clicked(self) -> None:
        """Show what is selected, unless the tab's tool is in use."""
        tab = self._ui.workspace.view.panel_tab or SCENE
        if self._ui.model.mode is None and tab in (SCENE, ROAD, STUDY):
            self._asked(AGENTS)
            self._left = tab

    def _return(self) -> None:
        left = self._left
        if left is not None and not self._ui.session.selection:
            self._asked(left)

    def _asked(self, tab: str) -> None:
        self._keep(tab)
        self._left = None
        asked = self._state.asked + 1
        self._state = msgspec.structs.replace(self._state, tab=tab, asked=asked)
        self._overlay.show(self._state)

    def _keep(self, tab: str) -> None:
        """Open this tab after a reload."""
        workspace = self._ui.workspace
        workspace.view = replace(workspace.view, panel_tab=tab)

    def _heard(self, event: PanelEvent) -> None:
        kind, title = event.kind, event.title
        if kind == "hold":
            self._ui.hold_slider()
        elif kind == "release":
            self._ui.release_slider()
        elif kind == "narrow":
            self._ui.client.gui.main_panel.minimize()
        else:
            self._keep(title[:60])
            if title != AGENTS:
                self._left = None
