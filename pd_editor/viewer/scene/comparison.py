"""Comparison with the original scenario, while O is held or permanently."""

from collections.abc import Mapping
from typing import Any

from pd_editor.scene.palette import Palette
from pd_editor.viewer.overlay.messages import CompareState
from pd_editor.viewer.scene.original_view import OriginalView, difference_notes
from pd_editor.viewer.tab.ui_context import UiContext


class Comparison:
    """Shows the original scenario and texts about its differences."""

    def __init__(self, ui: UiContext) -> None:
        """Show no original yet."""
        self._ui = ui
        self._overlay = ui.overlay
        self._view = OriginalView(ui.client, ui.model.palette)
        self._is_held = False
        self._is_kept = False
        self._overlay.on("compare", self._heard)
        self._overlay.show(CompareState())

    @property
    def is_on(self) -> bool:
        """Whether the original is shown."""
        return self._is_held or self._is_kept

    def hold(self) -> None:
        """Show the original until ``release``."""
        self._set(is_held=True)

    def release(self) -> None:
        """End what ``hold`` began."""
        self._set(is_held=False)

    def keep(self, is_kept: bool) -> None:
        """Show the original for as long as this is set."""
        self._set(is_kept=is_kept)

    def set_palette(self, palette: Palette) -> None:
        """Draw in another theme from the next frame on."""
        self._view.set_palette(palette)

    def show(self) -> None:
        """Draw the original at the playhead."""
        if not self.is_on:
            return
        session = self._ui.session
        step = self._ui.workspace.playback.step
        self._view.show(session.original, session.scenario, step)
        self._overlay.show(CompareState(text=self._summary()))

    def notes(self) -> dict[str, str]:
        """Note on each selected agent."""
        if not self.is_on:
            return {}
        session = self._ui.session
        return difference_notes(session.original, session.scenario, session.selection)

    def _summary(self) -> str:
        session, count = self._ui.session, self._view.num_changed
        original = set(session.original.agents.ids)
        added = sum(agent not in original for agent in session.scenario.agents.ids)
        parts = []
        if session.scenario.applied_warp != session.base.applied_warp:
            parts.append("the road is warped")
        if count:
            parts.append(
                f"{count} {'agent differs' if count == 1 else 'agents differ'}"
            )
        if added:
            parts.append(f"{added} added")
        return "Original: " + (", ".join(parts) if parts else "nothing has changed")

    def _heard(self, event: Mapping[str, Any]) -> None:
        if event.get("kind") == "hold":
            self.hold()
        elif event.get("kind") == "release":
            self.release()

    def _set(self, *, is_held: bool | None = None, is_kept: bool | None = None) -> None:
        before = self.is_on
        self._is_held = self._is_held if is_held is None else is_held
        self._is_kept = self._is_kept if is_kept is None else is_kept
        if self.is_on == before:
            return
        self._view.set_shown(self.is_on)
        if not self.is_on:
            self._overlay.show(CompareState())
        self._ui.model.compared.emit()
