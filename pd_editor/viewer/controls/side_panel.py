"""viser's panel beside the picture, as far as the page's script looks after it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from pd_editor.viewer.overlay.messages import PanelState
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.tab.ui_context import UiContext

MAX_TITLE: Final = 60
SCENE: Final = "Scene"
AGENTS: Final = "Agents"


class SidePanel:
    """Keeps the tab that is open, and opens it again after a reload.

    It also tells when the pointer takes a slider and lets it go, which viser does not;
    without the page's script a slider's gesture is over when it rests.
    """

    def __init__(self, overlay: Overlay, ui: UiContext, *, is_debug: bool) -> None:
        """Open the tab that was open; viser's own settings are offered to debug only."""
        self._ui = ui
        self._overlay = overlay
        self._state = PanelState(tab=ui.workspace.view.panel_tab, is_debug=is_debug)
        overlay.on("panel", self._heard)
        overlay.show(self._state)

    def agent_clicked(self) -> None:
        """Show the agent in the place of the scene, once: later the user chooses."""
        state = PanelState(tab=AGENTS, instead=SCENE, is_debug=self._state.is_debug)
        self._overlay.show(state)

    def _heard(self, event: Mapping[str, Any]) -> None:
        kind, title = event.get("kind"), event.get("title")
        if kind == "hold":
            self._ui.hold_slider()
        elif kind == "release":
            self._ui.release_slider()
        elif kind == "tab" and isinstance(title, str):
            workspace = self._ui.workspace
            workspace.view = replace(workspace.view, panel_tab=title[:MAX_TITLE])
