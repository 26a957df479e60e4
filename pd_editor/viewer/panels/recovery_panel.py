"""The recovery panel: work that an earlier run of the editor did not finish."""

import datetime
from typing import Final

import viser

from pd_editor.editor.journal import UnfinishedWork
from pd_editor.viewer.state.desk import Desk, set_property
from pd_editor.viewer.state.page_text import plain

MAX_OFFERED: Final = 3


class RecoveryPanel:
    """Offers the newest unfinished work, to take up again or to discard."""

    def __init__(self, desk: Desk) -> None:
        """Build it into the current container; hidden when there is none."""
        self._desk = desk
        self._workspace = desk.workspace
        gui = desk.client.gui
        self._folder = gui.add_folder("Unfinished work", visible=False)
        self._rows: list[tuple[viser.GuiMarkdownHandle, list]] = []
        with self._folder:
            for index in range(MAX_OFFERED):
                text = gui.add_markdown("", visible=False)
                restore = gui.add_button("Restore", visible=False)
                discard = gui.add_button("Discard", color="gray", visible=False)
                desk.on_click(restore, lambda index=index: self._restore(index))
                desk.on_click(discard, lambda index=index: self._discard(index))
                self._rows.append((text, [restore, discard]))
        self._offered: list[UnfinishedWork] = []
        self.refresh()
        if self._offered:
            desk.notify(
                "Unfinished work found",
                "An earlier run ended with edits not exported. "
                "Restore it in the Scene tab.",
                stays=True,
            )

    def refresh(self) -> None:
        """Look again at what is left unfinished."""
        self._offered = self._workspace.unfinished_work()[:MAX_OFFERED]
        set_property(self._folder, "visible", bool(self._offered))
        for index, (text, buttons) in enumerate(self._rows):
            is_used = index < len(self._offered)
            set_property(text, "visible", is_used)
            for button in buttons:
                set_property(button, "visible", is_used)
            if is_used:
                set_property(text, "content", _described(self._offered[index]))

    def _restore(self, index: int) -> None:
        self._desk.commit_gesture()
        self._workspace.restore(self._offered[index])
        self.refresh()

    def _discard(self, index: int) -> None:
        self._offered[index].discard()
        self.refresh()


def _described(work: UnfinishedWork) -> str:
    when = datetime.datetime.fromtimestamp(work.last_time)
    edits = f"{work.num_edits} edit{'s' if work.num_edits != 1 else ''}"
    return f"**{plain(work.scenario_id)}**  \n{edits}, last {when:%d %b %H:%M}"
