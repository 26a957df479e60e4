"""Unfinished work of all scenarios: a button with its amount, and a dialog."""

from typing import Any, Final

import viser

from pd_editor.editor.recipe import moment
from pd_editor.viewer.state.page_text import plain
from pd_editor.viewer.state.ui_context import UiContext, set_property
from pd_editor.viewer.state.workspace import KeptWork

MAX_LISTED: Final = 20


class UnfinishedPanel:
    """Lists edited scenarios that are not open, to continue or to discard."""

    def __init__(self, ui: UiContext) -> None:
        """Build the button into the current container."""
        self._ui = ui
        self._workspace = ui.workspace
        self._dialog: Any = None
        self._count = -1
        self._notice: viser.NotificationHandle | None = None
        self._button = ui.client.gui.add_button(
            "Unfinished work",
            color="gray",
            icon=viser.Icon.HISTORY,
            hint="Edits of other scenarios, to continue or to discard",
        )
        ui.on_click(self._button, self.open_dialog)
        self.refresh()
        if self._count and self._workspace.is_new:
            self._notice = ui.notify(
                "Unfinished work found",
                "Edits that were not exported are kept. Continue them in the Scene tab.",
                stays=True,
            )

    def refresh(self) -> None:
        """Update the count of unfinished work."""
        self._show_count(len(self._workspace.unfinished_work()))

    def open_dialog(self) -> None:
        """Show the list in a dialog."""
        self._ui.commit_gesture()
        self._close_dialog()
        self._remove_notice()
        found = self._workspace.unfinished_work()
        self._show_count(len(found))
        gui = self._ui.client.gui
        self._dialog = gui.add_modal("Unfinished work")
        with self._dialog:
            if not found:
                gui.add_markdown(
                    "There is none: no scenario but the open one is edited."
                )
            for work in found[:MAX_LISTED]:
                self._add_row(gui, work)
            if len(found) > MAX_LISTED:
                gui.add_markdown(f"... and {len(found) - MAX_LISTED} older ones")
            close = gui.add_button("Close", color="gray")
        self._ui.on_click(close, self._close_dialog)

    def _add_row(self, gui: viser.GuiApi, work: KeptWork) -> None:
        gui.add_markdown(_described(work))
        resume = gui.add_button(f"Continue {work.scenario_id}"[:60])
        discard = gui.add_button("Discard", color="gray")
        is_asked = False

        def discarded() -> None:
            nonlocal is_asked
            if not is_asked:
                is_asked = True
                discard.label, discard.color = "Discard for good?", "red"
                return
            self._workspace.discard(work)
            self.open_dialog()

        self._ui.on_click(resume, lambda: self._resume(work))
        self._ui.on_click(discard, discarded)

    def _resume(self, work: KeptWork) -> None:
        self._close_dialog()
        self._workspace.resume(work)
        self.refresh()

    def _close_dialog(self) -> None:
        if self._dialog is not None:
            self._dialog.close()
            self._dialog = None

    def _remove_notice(self) -> None:
        if self._notice is not None:
            self._notice.remove()
            self._notice = None

    def _show_count(self, count: int) -> None:
        self._count = count
        if not count:
            self._remove_notice()
        set_property(self._button, "label", f"Unfinished work ({count})")
        set_property(self._button, "disabled", count == 0)


def _described(work: KeptWork) -> str:
    when = moment(work.last_time)
    edits = f"{work.num_edits} edit{'s' if work.num_edits != 1 else ''}"
    name = f"  \n{plain(work.name)}" if work.name else ""
    return f"**{plain(work.scenario_id)}**{name}  \n{edits}, last {when:%d %b %H:%M}"
