"""What is done with several kept scenarios together, from the bar of the start page."""

import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from pd_editor.analysis.findings.finding import problems_in_words
from pd_editor.base.errors import InputError, PdEditorError
from pd_editor.base.plain_text import number_of
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.library.library import Library, LibraryCard
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.variant import tags_from_text
from pd_editor.scene.formats.player import player_page
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.files.scene_lists import Batch, TickedList
from pd_editor.viewer.files.start_page import StartPage
from pd_editor.viewer.tab.ui_context import UiContext

ZIP_NAME: Final = "scenarios.zip"


class LibraryActions:
    """Acts on what the library's list shows, or on what of it is ticked."""

    def __init__(self, ui: UiContext, export: ExportPanel, start: StartPage) -> None:
        """Scenarios are downloaded in the format that is chosen for exports."""
        self._export, self._start = export, start
        self._ui = ui
        self._workspace = ui.workspace
        self._library, self._scenes = ui.workspace.library, start.library
        self._zip = start.zip
        self._followed: LibraryCard | None = None
        """Card of the current state when it was looked at last."""
        self._actions: Mapping[str, Callable[[str], None]] = {
            "tick": lambda _tags: self._tick_found(),
            "metrics": lambda _tags: self._measure(),
            "zip-save": self._save_of_zip,
            "zip-download": lambda _tags: self._download_of_zip(),
            "tag": lambda tags: self._change_tags(tags, is_added=True),
            "untag": lambda tags: self._change_tags(tags, is_added=False),
            "compare": lambda _tags: self._compare_ticked(),
            "download": lambda _tags: self._download(),
            "remove": lambda _tags: self._remove_ticked(),
            "put-back": lambda _tags: self._put_removed_back(),
        }
        ui.model.save_requested.subscribe(self.save)
        start.acted.subscribe(lambda name, tags: self._actions[name](tags))
        start.listed.subscribe(self._follow_card)
        self._follow_card()

    def save(self) -> None:
        """Save the current state to the library, or tell that it is there already.

        One of which something else is said by now is described anew.
        """
        self._export.refuse_empty_name()
        self._ui.commit_gesture()
        if self._workspace.is_saved():
            self._ui.notify("This state is in the library already")
            return
        is_update = self._workspace.saved_card() is not None
        card = self._workspace.save()
        self._changed()
        self._export.written()
        self._ui.notify(
            f"{'Updated in the library' if is_update else 'Saved to library'}: {card.name}",
            f"With {problems_in_words(card.row.problems)}.",
            "warning" if card.row.problems else "success",
        )

    def _download(self) -> None:
        """Hand the chosen scenarios to the browser as one zip.

        Raises:
            InputError: none is there, or one cannot be read.
        """
        shown = set(self._scenes.chosen)
        self._start.look()
        there = {card.name for card in self._library.cards()} & shown
        self._send_zip(self._library, there)
        gone = sorted(shown - there)
        if gone:
            self._ui.notify(
                f"{number_of(len(gone), 'scenario')} not in the zip",
                f"Another tab has removed {', '.join(gone)} from the library.",
                "warning",
            )

    def _send_zip(self, library: Library, names: Collection[str]) -> None:
        content = library.zipped(names, self._export.format_name())
        self._ui.client.send_file_download(ZIP_NAME, content, save_immediately=True)

    def _download_of_zip(self) -> None:
        """Download scenes of an uploaded zip as if the library held them."""
        with tempfile.TemporaryDirectory() as folder:
            library = Library(Path(folder))
            for name in self._zip.chosen:
                self._zip.take_into(library, name)
            self._send_zip(library, library.folders())

    def _save_of_zip(self, text: str) -> None:
        tags = tags_from_text(text)

        def save(name: str) -> None:
            if not self._zip.take_into(self._library, name, tags):
                raise InputError("it is in the library already.")

        self._begin(self._zip, "zip-save", "Saved", save)

    def _measure(self) -> None:
        self._begin(self._scenes, "metrics", "Measured", self._library.measure)

    def _begin(
        self,
        scenes: TickedList[Any],
        button: str,
        words: str,
        do: Callable[[str], None],
    ) -> None:
        """Begin to work on what is chosen, or end what the same button has begun."""
        if scenes.batch is None:
            batch = Batch(button=button, words=words, do=do, left=scenes.chosen)
            scenes.batch = batch
            self._go_on(scenes, batch)
        else:
            self._end(scenes, scenes.batch)

    def _go_on(self, scenes: TickedList[Any], batch: Batch) -> None:
        """Work on the next one in a thread, so that the page goes on meanwhile."""
        if not batch.left:
            self._end(scenes, batch)
            return
        self._start.look()
        one = batch.left[0]

        def work(_job: BackgroundJob[Any]) -> str:
            batch.do(one)
            return one

        def ended(error: PdEditorError | None) -> None:
            self._ui.post(partial(self._done, scenes, batch, error))

        BackgroundJob(batch.words, work, lambda _one: ended(None), ended).start()

    def _done(
        self, scenes: TickedList[Any], batch: Batch, error: PdEditorError | None
    ) -> None:
        """Count what is done, unless the batch was cancelled meanwhile."""
        if scenes.batch is not batch:
            return
        name = batch.left.pop(0)
        batch.num_done += 1
        if error is not None:
            batch.failures.append(f"{name}: {error}")
        self._go_on(scenes, batch)

    def _end(self, scenes: TickedList[Any], batch: Batch) -> None:
        scenes.batch, failures = None, batch.failures
        self._changed()
        self._ui.notify(
            f"{batch.words} {number_of(batch.num_done - len(failures), 'scenario')}",
            f"{len(failures)} not, first: {failures[0]}" if failures else "",
            "warning" if failures else "success",
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

    def _tick_found(self) -> None:
        self._start.ticked_list.tick_all()
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
        told = f"{name}.html plays both on one clock, in any browser."
        self._ui.notify("Comparison downloaded", told)

    def _change_tags(self, text: str, *, is_added: bool) -> None:
        tags = tags_from_text(text)
        if not tags:
            raise InputError("Enter tags first, separated by commas.")
        given, taken = (tags, ()) if is_added else ((), tags)
        count = self._library.describe(
            self._scenes.chosen, lambda variant: variant.tagged(given, taken)
        )
        self._start.look()
        self._ui.notify(
            f"{number_of(count, 'scenario')} {'' if is_added else 'un'}tagged"
        )

    def _remove_ticked(self) -> None:
        names = self._scenes.ticked
        if not names:
            raise InputError("Tick what to remove from the library first.")
        self._scenes.remove(names)
        self._changed()

    def _put_removed_back(self) -> None:
        names, failures = self._workspace.removed, dict[str, PdEditorError]()
        renamed: list[str] = []
        for name in names:
            try:
                back = self._library.put_back(name)
            except PdEditorError as error:
                failures[name] = error
                continue
            if back != name:
                renamed.append(
                    f"{name} as {back}, for another one has its name by now."
                )
        self._workspace.removed = tuple(failures)
        self._changed()
        if failures:
            raise next(iter(failures.values()))
        told = f"{number_of(len(names), 'scenario')} put back"
        self._ui.notify(told, " ".join(renamed))

    def _changed(self) -> None:
        self._start.look()
        self._ui.model.library_changed.emit()
