"""The library: starred scenarios, listed at the end of the tab, downloaded together."""

import viser

from pd_editor.analysis.findings.finding import open_in_words
from pd_editor.editor.library.library import LibraryCard
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.tab.panel_style import PictureRows
from pd_editor.viewer.tab.ui_context import UiContext, set_property

ZIP_NAME = "scenarios.zip"


class LibraryPanel:
    """Buttons on top, which stay in place; below them the list, which grows."""

    def __init__(self, ui: UiContext, export: ExportPanel) -> None:
        """Build it into the current container, as the last thing in it.

        Scenarios are downloaded in the format that is chosen for exports.
        """
        self._export = export
        self._ui = ui
        self._workspace = ui.workspace
        self._entries: list[LibraryCard] = []
        self._stamp = 0
        self._rows: dict[str, viser.GuiButtonHandle] = {}
        gui = ui.client.gui
        self._folder = gui.add_folder("Library")
        with self._folder:
            self._download = gui.add_button(
                "Download 0 scenarios",
                icon=viser.Icon.DOWNLOAD,
                disabled=True,
                hint="One zip, in the format above: a folder for each ticked scenario, and index.csv",
            )
            self._remove = gui.add_button(
                "Remove the ticked", color="gray", disabled=True
            )
            self._put_back = gui.add_button(
                "Put back", color="gray", hint="What was removed last", visible=False
            )
            self._hint = gui.add_markdown("")
            self._pictures = PictureRows(gui)
        ui.on_click(self._download, self.download)
        ui.on_click(self._remove, self._remove_ticked)
        ui.on_click(self._put_back, self._put_removed_back)
        ui.model.star_requested.subscribe(self.star)
        self.refresh()

    def star(self) -> None:
        """Add the current state to the library, or tell that it is there already.

        One of which something else is said by now is described anew.
        """
        self._ui.commit_gesture()
        if self._workspace.is_saved():
            self._ui.notify("This state is in the library already")
            return
        is_update = self._workspace.saved_card() is not None
        entry = self._workspace.star()
        self.refresh()
        self._ui.notify(
            f"{'Updated in the library' if is_update else 'Starred'}: {entry.name}",
            f"With {open_in_words(entry.row.problems)}.",
            "warning" if entry.row.problems else "success",
        )

    def follow(self) -> None:
        """Show what other tabs have changed in the library."""
        if self._workspace.library.stamp() != self._stamp:
            self.refresh()

    def refresh(self) -> None:
        """Show what is in the library by now."""
        # Read first: a change in between then counts as one that follows.
        self._stamp = self._workspace.library.stamp()
        former = {entry.name: entry for entry in self._entries}
        self._entries = self._workspace.library.cards()
        now = {entry.name: entry for entry in self._entries}
        for name in [one for one in self._rows if former.get(one) != now.get(one)]:
            self._pictures.remove(self._rows.pop(name))
        self._workspace.unticked &= set(now)
        with self._folder:
            for entry in self._entries:
                if entry.name not in self._rows:
                    self._add_row(entry)
        self._show_count()

    def download(self) -> None:
        """Hand the ticked scenarios to the browser as one zip.

        Raises:
            InputError: none is ticked, or one cannot be read.
        """
        shown = set(self._ticked())
        self.refresh()
        there = set(self._ticked()) & shown
        content = self._workspace.library.zipped(there, self._export.format_name())
        self._ui.client.send_file_download(ZIP_NAME, content, save_immediately=True)
        gone = sorted(shown - there)
        if gone:
            self._ui.notify(
                f"{_scenarios(len(gone))} not in the zip",
                f"Another tab has removed {', '.join(gone)} from the library.",
                "warning",
            )

    def _add_row(self, entry: LibraryCard) -> None:
        count = entry.row.num_problems
        problems = f" ({count} problem{'s' if count != 1 else ''})" if count else ""
        row = self._pictures.add(
            f"{entry.name}{problems}",
            self._workspace.library.thumbnail(entry.name),
            hint="; ".join(entry.row.edits)[:500] or "without edits",
            # One that is shown anew keeps its place.
            order=entry.saved_at,
        )
        self._rows[entry.name] = row
        self._ui.on_click(row, lambda: self._toggle(entry.name))

    def _toggle(self, name: str) -> None:
        """Tick a scenario for the download, or take its tick away."""
        self._workspace.unticked ^= {name}
        self._show_count()

    def _remove_ticked(self) -> None:
        names = self._ticked()
        for name in names:
            self._workspace.library.remove(name)
        self._workspace.removed = tuple(names)
        self._changed()
        self._ui.notify(
            f"{_scenarios(len(names))} removed",
            f"{self._put_back.label}, in the library, brings back what was removed.",
        )

    def _put_removed_back(self) -> None:
        names, self._workspace.removed = self._workspace.removed, ()
        try:
            for name in names:
                self._workspace.library.put_back(name)
        finally:
            self._changed()

    def _changed(self) -> None:
        self.refresh()
        self._ui.model.library_changed.emit()

    def _ticked(self) -> list[str]:
        unticked = self._workspace.unticked
        return [one.name for one in self._entries if one.name not in unticked]

    def _show_count(self) -> None:
        for name, row in self._rows.items():
            is_ticked = name not in self._workspace.unticked
            icon = viser.Icon.SQUARE_CHECK if is_ticked else viser.Icon.SQUARE
            set_property(row, "icon", icon)
        count = len(self._ticked())
        set_property(self._download, "label", f"Download {_scenarios(count)}")
        removed = self._workspace.removed
        set_property(self._put_back, "label", f"Put back {_scenarios(len(removed))}")
        set_property(self._put_back, "visible", bool(removed))
        for button in (self._download, self._remove):
            set_property(button, "disabled", count == 0)
        hint = "" if self._entries else "*Empty: S puts the scenario at hand in here.*"
        set_property(self._hint, "content", hint)


def _scenarios(count: int) -> str:
    return f"{count} scenario{'s' if count != 1 else ''}"
