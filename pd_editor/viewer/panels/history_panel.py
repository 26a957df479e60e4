"""The history panel: every edit, to jump to."""

from typing import Final

import viser

from pd_editor.viewer.state.desk import Desk, set_property

MAX_SHOWN: Final = 14


class HistoryPanel:
    """Undo, redo, and a list of edits with the newest on top."""

    def __init__(self, desk: Desk) -> None:
        """Build it into the current tab."""
        self._desk = desk
        gui = desk.client.gui
        self._undo = gui.add_button(
            "Undo", icon=viser.Icon.ARROW_BACK_UP, color="gray", hint="Ctrl+Z"
        )
        self._redo = gui.add_button(
            "Redo", icon=viser.Icon.ARROW_FORWARD_UP, color="gray", hint="Ctrl+Shift+Z"
        )
        gui.add_markdown("**Edits, newest first.** Click one to go there.")
        self._rows: list[viser.GuiButtonHandle] = []
        self._positions = [0] * MAX_SHOWN
        for index in range(MAX_SHOWN):
            row = gui.add_button("-", color="gray", visible=False)
            self._rows.append(row)
            desk.on_click(row, lambda index=index: self._jump(index))
        self._older = gui.add_markdown("", visible=False)
        desk.on_click(self._undo, self.undo)
        desk.on_click(self._redo, self.redo)

    def undo(self) -> None:
        """Take back the last edit, if any."""
        self._desk.commit_gesture()
        if self._desk.session.can_undo:
            self._desk.session.undo()

    def redo(self) -> None:
        """Do again what was taken back, if anything."""
        self._desk.commit_gesture()
        if self._desk.session.can_redo:
            self._desk.session.redo()

    def show(self) -> None:
        """Show the session's history."""
        session = self._desk.session
        entries = session.entries
        position = session.state.position
        set_property(self._undo, "disabled", not session.can_undo)
        set_property(self._redo, "disabled", not session.can_redo)
        newest_first = list(range(len(entries), -1, -1))
        # The current position stays in sight, however far back it is.
        start = max(
            0,
            min(
                len(entries) - position - MAX_SHOWN // 2, len(newest_first) - MAX_SHOWN
            ),
        )
        shown = newest_first[max(start, 0) :][:MAX_SHOWN]
        for index, row in enumerate(self._rows):
            set_property(row, "visible", index < len(shown))
            if index >= len(shown):
                continue
            at = shown[index]
            self._positions[index] = at
            name = "Scenario opened" if at == 0 else f"{at}. {entries[at - 1].label}"
            set_property(row, "label", name)
            set_property(row, "color", "blue" if at == position else "gray")
        hidden = len(newest_first) - len(shown)
        set_property(self._older, "visible", hidden > 0)
        set_property(self._older, "content", f"... and {hidden} more")

    def _jump(self, index: int) -> None:
        self._desk.commit_gesture()
        self._desk.session.jump_to(self._positions[index])
