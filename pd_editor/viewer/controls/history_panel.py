"""The history panel: every edit, to jump to."""

from collections.abc import Callable
from typing import Final

import viser

from pd_editor.base.plain_text import number_of
from pd_editor.editor.history import HistoryEntry
from pd_editor.viewer.tab.panel_style import FixedText, PanelStyle
from pd_editor.viewer.tab.ui_context import UiContext, set_property

ROWS: Final = 12
OPENED: Final = "Scenario opened"
NEWER: Final = "Newer"
PRESENT: Final = "Present"
OLDER: Final = "Older"
_UNUSED: Final = "\N{EN DASH}"


class HistoryPanel:
    """Undo, redo, and pages of edits with the newest on top."""

    def __init__(
        self, ui: UiContext, style: PanelStyle, show_branches: Callable[[], None]
    ) -> None:
        """Build it into the current tab; ``show_branches`` opens or closes their strip."""
        self._ui = ui
        gui = ui.client.gui
        self._branches = gui.add_button(
            "Branches",
            icon=viser.Icon.GIT_BRANCH,
            color="gray",
            hint="Edits that were undone before another edit (U)",
        )
        ui.on_click(self._branches, show_branches)
        self._counts = FixedText(gui, 2, grows=True)
        self._pages = gui.add_button_group("Edits", (NEWER, PRESENT, OLDER))
        self._page = 0
        self._followed: tuple[object, int, int] | None = None
        self._rows = [gui.add_button(_UNUSED, color="gray") for _ in range(ROWS)]
        style.as_list(self._rows)
        for index, row in enumerate(self._rows):
            ui.on_click(row, lambda index=index: self._jump(index))
        ui.on_option(self._pages, self._turn_page)
        ui.model.shown.subscribe(self.show)

    def undo(self) -> None:
        """Undo the last edit, if any."""
        self._ui.commit_gesture()
        if self._ui.session.can_undo:
            self._ui.session.undo()

    def redo(self) -> None:
        """Redo the last undone edit, if any."""
        self._ui.commit_gesture()
        if self._ui.session.can_redo:
            self._ui.session.redo()

    def show(self) -> None:
        """Show the session's history; the page follows the present state."""
        session = self._ui.session
        entries, position = session.entries, session.state.position
        present = (session.base, session.state.tip, position)
        if self._followed != present:
            self._followed = present
            self._page = (len(entries) - position) // ROWS
        count = len(session.branch_tips)
        set_property(self._branches, "label", f"Branches: {count}")
        set_property(self._branches, "disabled", count < 2)
        set_property(self._pages, "visible", len(entries) >= ROWS)
        oldest = sum(entry.before is None for entry in entries)
        for index, row in enumerate(self._rows):
            at = self._position(index)
            set_property(row, "visible", at is not None)
            set_property(row, "disabled", at is None or at < oldest)
            set_property(row, "label", _row_text(entries, at, position))
            is_present = at == position
            is_undone = at is not None and at > position
            color = "blue" if is_present else "orange" if is_undone else "gray"
            set_property(row, "color", color)
        self._counts.show(*self._counted(len(entries), position))

    def _position(self, index: int) -> int | None:
        """Number of edits in force in the state of a row; None for an unused row."""
        at = len(self._ui.session.entries) - self._page * ROWS - index
        return at if at >= 0 else None

    def _counted(self, count: int, position: int) -> tuple[str, str]:
        if not count:
            return "No edits yet", ""
        undone = count - position
        title = f"{number_of(position, 'edit')} in force" + (
            f", {undone} undone" if undone else ""
        )
        if count < ROWS:
            return title, ""
        newest = count - self._page * ROWS
        oldest = max(newest - ROWS + 1, 1)
        if newest == 0:
            return title, "Shown: the scenario as opened."
        shown = f"{newest} to {oldest}" if newest > oldest else f"{newest}"
        return title, f"Shown: {shown} of {count}, newest first."

    def _turn_page(self, where: str) -> None:
        session = self._ui.session
        count = len(session.entries)
        page = {
            NEWER: self._page - 1,
            OLDER: self._page + 1,
            PRESENT: (count - session.state.position) // ROWS,
        }.get(where, self._page)
        self._page = min(max(page, 0), count // ROWS)
        self.show()

    def _jump(self, index: int) -> None:
        position = self._position(index)
        self._ui.commit_gesture()
        if position is not None:
            self._ui.session.jump_to(position)


def _row_text(entries: tuple[HistoryEntry, ...], at: int | None, position: int) -> str:
    if at is None:
        return _UNUSED
    name = OPENED if at == 0 else f"{at}. {entries[at - 1].label}"
    if at == position:
        return f"\N{BLACK RIGHT-POINTING TRIANGLE} {name}"
    return f"(undone) {name}" if at > position else name
