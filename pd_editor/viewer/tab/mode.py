"""Modes in which presses on the picture mean something else; at most one is active."""

from typing import Any, ClassVar, Final

from pd_editor.viewer.overlay.overlay import MODE
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.tab.ui_context import UiContext

BY_KEYS: Final = "Arrows and Enter press, too."
"""What the page's cross does in every mode (``aim.ts``)."""


class Mode:
    """A mode with its sentence in the banner and its element over the picture."""

    name: ClassVar[str]
    """Name of the element, whose events ``_heard`` handles."""
    button: ClassVar[str] = "Done (Esc)"

    def __init__(self, ui: UiContext) -> None:
        """Make the mode, switched off."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self.is_active = False
        self.changed = Signal[()]()
        """The mode has begun or ended, or does something else by now."""
        self._overlay.on(self.name, self._heard)

    def stop(self) -> None:
        """End the mode, if it is active."""
        if self.is_active:
            self._set_active(False)

    def _set_active(self, is_active: bool) -> None:
        self.is_active = is_active
        self._changed()

    def _sentence(self) -> str:
        """What the banner says while the mode is active."""
        raise NotImplementedError

    def _show(self) -> None:
        """Show the mode in the page."""
        raise NotImplementedError

    def _heard(self, event: Any) -> None:
        """Handle an event of the page."""

    def _changed(self) -> None:
        """Show and tell that the mode is another one by now; it ends the former one."""
        banner, former = self._ui.banner, self._model.mode
        if self.is_active:
            banner.show(
                self.name,
                f"{self._sentence()} {BY_KEYS}",
                buttons={self.button: self.stop},
                priority=MODE,
            )
            self._model.mode = self
            if former is not None and former is not self:
                former.stop()
        else:
            banner.hide(self.name)
            if former is self:
                self._model.mode = None
        self.changed.emit()
        self._show()
        self._model.mode_changed.emit()
