"""The library's panel: what is done with several kept scenarios together."""

from dataclasses import replace
from functools import partial

import viser

from pd_editor.analysis.findings.finding import problems_in_words
from pd_editor.base.errors import ExportError, InputError
from pd_editor.editor.library.library import LibraryCard
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.variant import tags_from_text
from pd_editor.scene.formats.player import player_page
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.files.scene_lists import scenarios
from pd_editor.viewer.files.start_page import StartPage
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property

ZIP_NAME = "scenarios.zip"
_ALL, _NONE = "All found", "Nothing"


class LibraryPanel:
    """Buttons for what the list of the library shows, or for what of it is ticked."""

    def __init__(self, ui: UiContext, export: ExportPanel, start: StartPage) -> None:
        """Build it into the current container, as the last thing in it.

        Scenarios are downloaded in the format that is chosen for exports.
        """
        self._export, self._start = export, start
        self._ui = ui
        self._workspace = ui.workspace
        self._library, self._scenes = ui.workspace.library, start.library
        self._followed: LibraryCard | None = None
        """Card of the current state when it was looked at last."""
        gui = ui.client.gui
        with gui.add_folder("Library"):
            place = str(self._library.root) if self._workspace.folders.is_local else ""
            FixedText(gui, 1).show("", place or "Of this browser.")
            self._show_all = gui.add_button(
                "Show library", icon=viser.Icon.LAYOUT_GRID, hint="Space ticks there"
            )
            self._count = FixedText(gui, 2)
            self._tick = gui.add_button_group("Tick", (_ALL, _NONE))
            self._add_buttons()
        self._connect()
        self._follow()

    def _add_buttons(self) -> None:
        gui = self._ui.client.gui
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
        ui.on_click(self._show_all, lambda: self._start.open("library"))
        ui.on_option(self._tick, self._tick_found)
        ui.on_click(self._compare, self._compare_ticked)
        ui.on_click(self._download, self.download)
        ui.on_click(self._tag, partial(self._change_tags, is_added=True))
        ui.on_click(self._untag, partial(self._change_tags, is_added=False))
        ui.on_click(self._remove, self._remove_chosen)
        ui.on_click(self._put_back, self._put_removed_back)
        ui.model.save_requested.subscribe(self.save)
        self._start.listed.subscribe(self._follow)

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
        self._start.look()
        self._ui.notify(
            f"{'Updated in the library' if is_update else 'Saved to library'}: {card.name}",
            f"With {problems_in_words(card.row.problems)}.",
            "warning" if card.row.problems else "success",
        )

    def download(self) -> None:
        """Hand the chosen scenarios to the browser as one zip.

        Raises:
            InputError: none is there, or one cannot be read.
        """
        shown = set(self._scenes.chosen)
        self._start.look()
        there = {card.name for card in self._library.cards()} & shown
        content = self._library.zipped(there, self._export.format_name())
        self._ui.client.send_file_download(ZIP_NAME, content, save_immediately=True)
        gone = sorted(shown - there)
        if gone:
            self._ui.notify(
                f"{scenarios(len(gone))} not in the zip",
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

    def _follow(self) -> None:
        """Show what is in the library by now."""
        self._follow_card()
        chosen, ticked = scenarios(len(self._scenes.chosen)), len(self._scenes.ticked)
        self._count.show("", self._scenes.told)
        set_property(self._download, "label", f"Download {chosen}")
        set_property(self._tag, "label", f"Tag {chosen}")
        set_property(self._untag, "label", f"Untag {chosen}")
        set_property(self._remove, "label", f"Remove {scenarios(ticked)}")
        for button in (self._download, self._tag, self._untag):
            set_property(button, "disabled", not self._scenes.items)
        set_property(self._remove, "disabled", not ticked)
        set_property(self._compare, "disabled", ticked != 2)
        removed = self._workspace.removed
        set_property(self._put_back, "label", f"Put back {scenarios(len(removed))}")
        set_property(self._put_back, "visible", bool(removed))

    def _tick_found(self, option: str) -> None:
        """Tick all that is found, or none at all."""
        if option == _ALL:
            self._workspace.ticked |= set(self._scenes.listed)
        else:
            self._workspace.ticked.clear()
        self._start.look()

    def _compare_ticked(self) -> None:
        names = self._scenes.ticked
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
            self._scenes.chosen, lambda variant: variant.tagged(given, taken)
        )
        self._start.look()
        self._ui.notify(f"{scenarios(count)} {'' if is_added else 'un'}tagged")

    def _remove_chosen(self) -> None:
        names = self._scenes.ticked
        if not names:
            raise InputError("Tick what to remove from the library first.")
        self._scenes.remove(names)
        self._changed()

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
        self._ui.notify(f"{scenarios(len(names))} put back")

    def _changed(self) -> None:
        self._start.look()
        self._ui.model.library_changed.emit()
