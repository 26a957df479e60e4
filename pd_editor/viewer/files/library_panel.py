"""The library: kept scenarios, filtered by one line, tagged and downloaded together."""

import os
from dataclasses import replace
from functools import partial
from typing import Final

import viser

from pd_editor.analysis.findings.finding import problems_in_words
from pd_editor.base.errors import ExportError, InputError
from pd_editor.editor.library.library import SORTS, LibraryCard
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.variant import tags_from_text
from pd_editor.experiments.scene_index.find import find_places
from pd_editor.experiments.scene_index.index_file import SceneIndex
from pd_editor.scene.formats.player import player_page
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.tab.panel_style import FixedText, PicturePages, PictureRow
from pd_editor.viewer.tab.ui_context import UiContext, set_property

ZIP_NAME = "scenarios.zip"
_ALL, _NONE = "All found", "Nothing"
PAGE: Final = 12
"""Number of scenarios that are shown at a time."""
_ORDERS: Final = {
    "Newest first": "date",
    "Name": "name",
    "Base": "base",
    "City": "city",
    "Most problems": "problems",
    "Most agents": "agents",
}


class LibraryPanel:
    """A line that filters, buttons for what it leaves or what of it is ticked, and rows."""

    def __init__(self, ui: UiContext, export: ExportPanel) -> None:
        """Build it into the current container, as the last thing in it.

        Scenarios are downloaded in the format that is chosen for exports.
        """
        self._export = export
        self._ui = ui
        self._workspace = ui.workspace
        self._library, self._run = ui.workspace.library, ui.workspace.shelf.index_run
        self._cards: list[LibraryCard] = []
        self._seen: tuple[int, int] | None = None
        self._index_told: tuple[object, SceneIndex] = None, self._run.index
        """The index with facts of the cards, and the state of both."""
        self._told = ""
        """What the line has found."""
        self._indexed = -1
        """State of the library that was read for queries."""
        self._followed: LibraryCard | None = None
        """Card of the current state when it was looked at last."""
        gui = ui.client.gui
        with gui.add_folder("Library"):
            place = str(self._library.root) if self._workspace.folders.is_local else ""
            FixedText(gui, 1).show("", place or "Of this browser.")
            self._line = gui.add_text(
                "Find",
                "",
                hint="Words of names, tags, notes, cities and edits; or what happens,"
                " such as: cut-in and density > 5; or of families: power > 5 and parent = name",
            )
            self._sort = gui.add_dropdown("Sort", tuple(_ORDERS))
            self._count = FixedText(gui, 2)
            self._tick = gui.add_button_group("Tick", (_ALL, _NONE))
            self._add_buttons()
            self._pages = PicturePages[LibraryCard](
                ui,
                PAGE,
                choose=self._toggle,
                row_of=self._row,
                picture_of=lambda card: self._library.thumbnail(card.name),
            )
        self._connect()
        self.refresh()

    def _add_buttons(self) -> None:
        gui = self._ui.client.gui
        self._open = gui.add_button(
            "Open from library",
            icon=viser.Icon.FOLDER_OPEN,
            hint="The one that is ticked",
        )
        self._compare = gui.add_button(
            "Compare two",
            color="gray",
            hint="A page that plays the two that are ticked side by side, on one clock",
        )
        self._download = gui.add_button(
            "Download 0 scenarios",
            icon=viser.Icon.DOWNLOAD,
            hint="One zip, in the format above: a folder for each scenario, and index.csv",
        )
        self._tags = gui.add_text("Tags of these", "", hint="Separated by commas")
        self._tag = gui.add_button("Tag 0 scenarios", color="gray")
        self._untag = gui.add_button("Untag 0 scenarios", color="gray")
        self._remove = gui.add_button(
            "Remove 0 scenarios", color="gray", hint="Those that are ticked"
        )
        self._put_back = gui.add_button(
            "Put back",
            color="gray",
            hint="All that was removed here",
            visible=False,
        )

    def _connect(self) -> None:
        ui = self._ui
        for handle in (self._line, self._sort):
            ui.on_change(handle, lambda _value: self.refresh(), merge_key="library")
        ui.on_option(self._tick, self._tick_found)
        ui.on_click(self._open, self._open_ticked)
        ui.on_click(self._compare, self._compare_ticked)
        ui.on_click(self._download, self.download)
        ui.on_click(self._tag, partial(self._change_tags, is_added=True))
        ui.on_click(self._untag, partial(self._change_tags, is_added=False))
        ui.on_click(self._remove, self._remove_chosen)
        ui.on_click(self._put_back, self._put_removed_back)
        ui.model.save_requested.subscribe(self.save)

    @property
    def listed(self) -> list[str]:
        """Names of the scenarios that pass the filter, in their order."""
        return [card.name for card in self._cards]

    @property
    def chosen(self) -> list[str]:
        """Those of them that are ticked; all of them if none is."""
        return self._ticked or self.listed

    @property
    def _ticked(self) -> list[str]:
        return [one for one in self.listed if one in self._workspace.ticked]

    def save(self) -> None:
        """Save the current state to the library, or tell that it is there already.

        One of which something else is said by now is described anew.
        """
        self._ui.commit_gesture()
        if self._workspace.is_saved():
            self._ui.notify("This state is in the library already")
            return
        is_update = self._workspace.saved_card() is not None
        card = self._workspace.save()
        self.refresh()
        self._ui.notify(
            f"{'Updated in the library' if is_update else 'Saved to library'}: {card.name}",
            f"With {problems_in_words(card.row.problems)}.",
            "warning" if card.row.problems else "success",
        )

    def follow(self) -> None:
        """Show what other tabs and programs have changed in the library."""
        if (self._library.stamp(), self._run.stamp) != self._seen:
            self.refresh()

    def refresh(self) -> None:
        """Show what is in the library by now."""
        # Looked at first: a change in between then counts as one that follows.
        self._seen = self._library.stamp(), self._run.stamp
        self._follow_card()
        cards = self._library.cards()
        self._workspace.ticked &= {card.name for card in cards}
        line, wrong = str(self._line.value).strip(), ""
        if line:
            try:
                if self._index_told[0] != self._seen:
                    told = self._run.index.beside(self._library.facts())
                    self._index_told = self._seen, told
                places = find_places(self._index_told[1], line)
                found = set(map(os.path.basename, places))
                self._index()
            except InputError as error:
                found, wrong = set[str](), str(error)
            words = line.split()
            cards = [card for card in cards if card.name in found or card.has(words)]
        self._cards = sorted(cards, key=SORTS[_ORDERS[str(self._sort.value)]])
        # Of words that are found in texts, no query is expected.
        more = (wrong if not cards else "") if wrong else self._run.words
        self._told = f"{len(cards)} found. {more}" if line else ""
        self._show()

    def download(self) -> None:
        """Hand the chosen scenarios to the browser as one zip.

        Raises:
            InputError: none is there, or one cannot be read.
        """
        shown = set(self.chosen)
        self.refresh()
        there = {card.name for card in self._library.cards()} & shown
        content = self._library.zipped(there, self._export.format_name())
        self._ui.client.send_file_download(ZIP_NAME, content, save_immediately=True)
        gone = sorted(shown - there)
        if gone:
            self._ui.notify(
                f"{_scenarios(len(gone))} not in the zip",
                f"Another tab has removed {', '.join(gone)} from the library.",
                "warning",
            )

    def _follow_card(self) -> None:
        """Take tags and note that others have given to the card of the current state."""
        card, former = self._workspace.saved_card(), self._followed
        self._followed = card
        if card is None or former is None or card.saved_at != former.saved_at:
            return
        session = self._ui.session
        about, row, old = session.variant, card.row, former.row
        if (row.tags, row.note) != (old.tags, old.note) == (about.tags, about.note):
            session.describe(replace(about, tags=row.tags, note=row.note))

    def _index(self) -> None:
        """Read what happens in scenarios that are new, in the background."""
        stamp = self._library.stamp()
        if stamp != self._indexed and self._run.fraction is None:
            self._indexed = stamp
            self._run.start()

    def _show(self) -> None:
        self._pages.show(self._cards)
        chosen, ticked = _scenarios(len(self.chosen)), len(self._ticked)
        said = f"{ticked} ticked" if ticked else "buttons are for all of them"
        if self._cards:
            told = self._told or f"{_scenarios(len(self._cards))}; {said}."
        else:
            told = self._told or "Empty: S saves the scenario at hand here."
        self._count.show("", told)
        set_property(self._download, "label", f"Download {chosen}")
        set_property(self._tag, "label", f"Tag {chosen}")
        set_property(self._untag, "label", f"Untag {chosen}")
        set_property(self._remove, "label", f"Remove {_scenarios(ticked)}")
        for button in (self._download, self._tag, self._untag):
            set_property(button, "disabled", not self._cards)
        set_property(self._remove, "disabled", not ticked)
        set_property(self._open, "disabled", len(self.chosen) != 1)
        set_property(self._compare, "disabled", ticked != 2)
        removed = self._workspace.removed
        set_property(self._put_back, "label", f"Put back {_scenarios(len(removed))}")
        set_property(self._put_back, "visible", bool(removed))

    def _toggle(self, card: LibraryCard) -> None:
        """Tick a scenario, or take its tick away."""
        self._workspace.ticked ^= {card.name}
        self._show()

    def _tick_found(self, option: str) -> None:
        """Tick all that is found, or none at all."""
        if option == _ALL:
            self._workspace.ticked |= set(self.listed)
        else:
            self._workspace.ticked.clear()
        self._show()

    def _row(self, card: LibraryCard) -> PictureRow:
        row, is_ticked = card.row, card.name in self._workspace.ticked
        count = row.num_problems
        problems = f"{count} problem{'s' * (count != 1)}" if count else ""
        edits = "; ".join(row.edits) or "without edits"
        title = " · ".join(filter(None, [card.name, problems, *row.tags]))
        return PictureRow(
            label="\n".join(filter(None, [title, row.lineage, row.note])),
            hint=f"{row.note} {edits}".strip(),
            icon=viser.Icon.SQUARE_CHECK if is_ticked else viser.Icon.SQUARE,
            drawn=card,
            is_ticked=is_ticked,
        )

    def _open_ticked(self) -> None:
        self._ui.commit_gesture()
        if len(self.chosen) != 1:
            raise InputError("Tick one scenario of the library to open it.")
        self._workspace.open_reference(str(self._library.root / self.chosen[0]))

    def _compare_ticked(self) -> None:
        names = self._ticked
        if len(names) != 2:
            raise InputError("Tick the two scenarios of the library to compare.")
        scenes = [open_scenario(self._library.root / one) for one in names]
        name = "-beside-".join(names)
        content = player_page(scenes, is_pair=True)
        self._ui.client.send_file_download(
            f"{name}.html", content, save_immediately=True
        )

    def _change_tags(self, *, is_added: bool) -> None:
        tags = tags_from_text(str(self._tags.value))
        if not tags:
            raise InputError("Enter tags first, separated by commas.")
        given, taken = (tags, ()) if is_added else ((), tags)
        count = self._library.describe(
            self.chosen, lambda variant: variant.tagged(given, taken)
        )
        self.refresh()
        self._ui.notify(f"{_scenarios(count)} {'' if is_added else 'un'}tagged")

    def _remove_chosen(self) -> None:
        names = self._ticked
        if not names:
            raise InputError("Tick what to remove from the library first.")
        for name in names:
            self._library.remove(name)
        removed = dict.fromkeys((*self._workspace.removed, *names))
        self._workspace.removed = tuple(removed)
        self._changed()
        self._ui.notify(
            f"{_scenarios(len(names))} removed",
            f"{self._put_back.label}, in the library, brings back what was removed.",
        )

    def _put_removed_back(self) -> None:
        names, self._workspace.removed = self._workspace.removed, ()
        failures: list[ExportError] = []
        for name in names:
            try:
                self._library.put_back(name)
            except ExportError as error:
                failures.append(error)
        self._changed()
        if failures:
            raise failures[0]
        self._ui.notify(f"{_scenarios(len(names))} put back")

    def _changed(self) -> None:
        self.refresh()
        self._ui.model.library_changed.emit()


def _scenarios(count: int) -> str:
    return f"{count} scenario{'s' if count != 1 else ''}"
