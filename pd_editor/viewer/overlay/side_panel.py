"""viser's panel beside the picture, as far as the page's script looks after it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.state.workspace import Workspace

MAX_TITLE: Final = 60


class SidePanel:
    """Keeps the tab that is open, and opens it again after a reload."""

    def __init__(
        self, overlay: Overlay, workspace: Workspace, *, is_debug: bool
    ) -> None:
        """Open the tab that was open; viser's own settings are offered to debug only."""
        self._workspace = workspace
        overlay.on("panel", self._heard)
        overlay.show("panel", {"tab": workspace.view.panel_tab, "isDebug": is_debug})

    def _heard(self, event: Mapping[str, Any]) -> None:
        title = event.get("title")
        if event.get("kind") == "tab" and isinstance(title, str):
            workspace = self._workspace
            workspace.view = replace(workspace.view, panel_tab=title[:MAX_TITLE])
