"""Unfinished work of all scenarios: a button with its amount, and a dialog."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any, Final

import viser

from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import moment
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import UnfinishedWork
from pd_editor.editor.variant import short_id
from pd_editor.viewer.state.session_shelf import KeptWork
from pd_editor.viewer.state.workspace import base_of
from pd_editor.viewer.tab.panel_style import PictureRows
from pd_editor.viewer.tab.ui_context import UiContext, set_property

MAX_LISTED: Final = 40


class UnfinishedPanel:
    """Lists edited scenarios that are not open, to continue or to discard."""

    def __init__(self, ui: UiContext) -> None:
        """Build the button into the current container."""
        self._ui = ui
        self._workspace = ui.workspace
        self._shelf = ui.workspace.shelf
        self._dialog: Any = None
        self._count = -1
        self._stamp: tuple[int, ...] = ()
        self._notice: viser.NotificationHandle | None = None
        self._button = ui.client.gui.add_button(
            "Unfinished work",
            color="gray",
            icon=viser.Icon.HISTORY,
            hint="Edits of other scenarios, to continue or to discard",
        )
        ui.on_click(self._button, self.open_dialog)
        ui.model.library_changed.subscribe(self.follow)
        ui.model.scene_shown.subscribe(lambda: ui.post(self.follow))
        self.follow()
        if self._count and self._workspace.is_new:
            self._notice = ui.notify(
                "Unfinished work found",
                "Edits that were not exported are kept. Continue them in the Scene tab.",
                stays=True,
            )

    def follow(self) -> None:
        """Show how much unfinished work there is, also of other tabs."""
        stamp = self._shelf.stamp()
        if stamp != self._stamp:
            self._stamp = stamp
            self._show_count(len(self._shelf.unfinished()))

    def open_dialog(self) -> None:
        """Show the list in a dialog."""
        self._ui.commit_gesture()
        self._close_dialog()
        self._remove_notice()
        found = self._shelf.unfinished()
        self._show_count(len(found))
        gui = self._ui.client.gui
        self._dialog = gui.add_modal("Unfinished work")
        with self._dialog:
            gui.add_markdown(
                "Click the one to continue."
                if found
                else "There is none: no scenario but the open one is edited."
            )
            discard = gui.add_button(
                "Discard some ...", color="gray", disabled=not found
            )
            rows = PictureRows(gui)
            buttons = [rows.add(_described(work)) for work in found[:MAX_LISTED]]
            if len(found) > MAX_LISTED:
                gui.add_markdown(f"... and {len(found) - MAX_LISTED} older ones")
            close = gui.add_button("Close", color="gray")

        self._ui.on_click(close, self._close_dialog)
        self._follow_ticks(found, buttons, discard)
        self._rows = rows
        rows.draw_later(
            self._ui.post,
            [
                (button, partial(_picture, work.place))
                for button, work in zip(buttons, found, strict=False)
            ],
        )

    def _follow_ticks(
        self,
        found: Sequence[KeptWork],
        buttons: Sequence[viser.GuiButtonHandle],
        discard: viser.GuiButtonHandle,
    ) -> None:
        """Continue the one that is pressed, or tick it once some are to be discarded."""
        ticked: dict[int, bool] = {}

        def pressed(number: int) -> None:
            if not ticked:
                self._close_dialog()
                self._workspace.resume(found[number])
                return
            ticked[number] = not ticked[number]
            show_ticks()

        def show_ticks() -> None:
            for number, button in enumerate(buttons):
                icon = viser.Icon.TRASH if ticked[number] else viser.Icon.SQUARE
                set_property(button, "icon", icon)
            count = sum(ticked.values())
            set_property(discard, "disabled", not count)
            set_property(discard, "color", "red")
            set_property(discard, "label", f"Discard {count} for good")

        def discarded() -> None:
            if not ticked:
                ticked.update(dict.fromkeys(range(len(buttons)), False))
                show_ticks()
                return
            for number, is_meant in ticked.items():
                if is_meant:
                    self._shelf.discard(found[number])
            self.open_dialog()

        for number, button in enumerate(buttons):
            self._ui.on_click(button, lambda number=number: pressed(number))
        self._ui.on_click(discard, discarded)

    def _close_dialog(self) -> None:
        if self._dialog is not None:
            self._dialog.close()
            self._rows.is_closed, self._dialog = True, None

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


def _picture(place: EditorSession | UnfinishedWork) -> str:
    """The scenario, or the base of one that is on disk: a replay would take too long."""
    if isinstance(place, EditorSession):
        return thumbnail(place.scenario)
    return _base_picture(place)


@lru_cache(maxsize=64)
def _base_picture(work: UnfinishedWork) -> str:
    return thumbnail(base_of(work))


def _described(work: KeptWork) -> str:
    edits = f"{work.num_edits} edit{'s' if work.num_edits != 1 else ''}"
    name = work.name or short_id(work.scenario_id)
    return f"{name} · {edits}, last {moment(work.last_time):%d %b %H:%M}"
