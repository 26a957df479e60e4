"""What one browser tab works on; it outlives the tab's connection."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from pd_editor.av2_io.dataset import CardFilter, DatasetIndex, ScenarioCard
from pd_editor.av2_io.upload import scenario_from_upload
from pd_editor.editor.journal import (
    Journal,
    UnfinishedWork,
    find_unfinished,
    restore,
)
from pd_editor.editor.session import EditorSession
from pd_editor.errors import InputError
from pd_editor.exporters.bundle import zip_files
from pd_editor.scenario_store import export_into, exported_files, open_scenario
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.playback import Playback
from pd_editor.viewer.state.view_memory import ViewMemory

SEARCH_STEP: Final = 4
"""Scenario folders looked at before the clock is looked at again."""
SEARCH_TURN_S: Final = 0.008
"""How long a search goes on between two messages of the user or frames."""
_let_go: Final[set[Path]] = set()
"""Journals of work that tabs of this process have left."""


class DatasetSearch:
    """A filter on its way through a dataset."""

    def __init__(self, dataset: DatasetIndex, wanted: CardFilter) -> None:
        """Begin at the first folder."""
        self._dataset = dataset
        self.wanted = wanted
        self.cards: list[ScenarioCard] = []
        self.num_seen = 0
        self.is_complete = False

    def go_on(self) -> None:
        """Look at some more folders."""
        end = time.monotonic() + SEARCH_TURN_S
        while not self.is_complete and time.monotonic() < end:
            step = self._dataset.search(self.wanted, self.num_seen, SEARCH_STEP)
            self.cards += step.cards
            self.num_seen = step.next_start
            self.is_complete = step.is_complete

    def cities(self) -> tuple[str, ...]:
        """Cities seen so far."""
        return self._dataset.cities()


class Workspace:
    """An editing session, its playhead, and where scenarios come from and go to."""

    def __init__(
        self,
        scenario: Scenario,
        *,
        dataset: DatasetIndex | None,
        journals: Path,
        is_local: bool = True,
    ) -> None:
        """Work on a scenario; edits are journaled in the folder ``journals``."""
        self.is_local = is_local
        self._journals = journals
        self._exported: Scenario | None = None
        self.session = EditorSession(scenario, journal=Journal(journals))
        self.playback = Playback()
        self.playback.open(scenario.time_axis)
        self.playback.last_step = scenario.last_step
        self.starts_playing = True
        self.is_dark = False
        self.view = ViewMemory()
        self.dataset = dataset
        self.search = None if dataset is None else DatasetSearch(dataset, CardFilter())

    def refuse_remote(self) -> None:
        """Keep this machine's folders from browsers of other machines.

        Raises:
            InputError: the editor listens to other machines.
        """
        if not self.is_local:
            raise InputError(
                "Folders of the server's machine are closed while the editor listens "
                "to other machines (--host); upload and download instead."
            )

    def open_reference(self, reference: str) -> None:
        """Open a demo or a scenario folder.

        Raises:
            InputError: it cannot be read; what was open stays open.
        """
        self._open(open_scenario(reference))

    def open_upload(self, files: Mapping[str, bytes]) -> None:
        """Open uploaded files; their bytes are kept beside the journal.

        Raises:
            InputError: they cannot be read; what was open stays open.
        """
        self._open(scenario_from_upload(files), files)

    def _open(
        self, scenario: Scenario, base_files: Mapping[str, bytes] | None = None
    ) -> None:
        self._let_go_of_journal()
        self.session.open(scenario, base_files, discard_former=self._is_exported)

    @property
    def _is_exported(self) -> bool:
        """Whether the scenario as it is now was exported."""
        return self.session.scenario is self._exported

    def search_for(self, wanted: CardFilter) -> None:
        """Start another search through the dataset."""
        if self.dataset is not None:
            self.search = DatasetSearch(self.dataset, wanted)

    def search_on(self) -> bool:
        """Let the search go on a little; whether it found out more."""
        if self.search is None or self.search.is_complete:
            return False
        self.search.go_on()
        return True

    def open_from_dataset(self, scenario_id: str) -> None:
        """Open a scenario that the search has found."""
        cards = [] if self.search is None else self.search.cards
        for card in cards:
            if card.scenario_id == scenario_id:
                self.open_reference(str(card.folder))
                return
        raise InputError(f"The dataset search has not found {scenario_id}.")

    def open_neighbour(self, direction: int) -> None:
        """Open the next (+1) or previous (-1) scenario under the filter.

        Raises:
            InputError: there is none.
        """
        if self.dataset is None or self.search is None:
            raise InputError("Start the editor with --data DIR to browse a dataset.")
        base, wanted = self.session.base, self.search.wanted
        if self.dataset.root.resolve() in Path(base.provenance.source).parents:
            step = self.dataset.after if direction > 0 else self.dataset.before
            card = step(base.scenario_id, wanted)
        else:
            # What is open is no member of the dataset: begin at its start.
            card = next(iter(self.search.cards), None)
        if card is None:
            raise InputError("There is no further scenario under this filter.")
        self.open_reference(str(card.folder))

    def exported_zip(self) -> tuple[str, bytes]:
        """Name and bytes of a zip with the scenario and its recipe."""
        self.session.commit_gesture()
        scenario = self.session.scenario
        files = exported_files(scenario, self.session.recipe())
        self._exported = scenario
        name = scenario.scenario_id
        return f"{name}.zip", zip_files(files, name)

    def export_into(self, out: Path) -> Path:
        """Write the scenario and its recipe as a new folder in ``out``."""
        self.session.commit_gesture()
        scenario = self.session.scenario
        folder = export_into(
            out, scenario.scenario_id, scenario, self.session.recipe(), overwrite=True
        )
        self._exported = scenario
        return folder

    def unfinished_work(self) -> list[UnfinishedWork]:
        """What earlier runs of the editor left, the newest first.

        What tabs of this run have let go is theirs, and is offered after a restart.
        """
        return [
            work for work in find_unfinished(self._journals) if work.path not in _let_go
        ]

    def _let_go_of_journal(self) -> None:
        self.session.commit_gesture()
        if self.session.journal_path is not None:
            _let_go.add(self.session.journal_path)

    def restore(self, work: UnfinishedWork) -> None:
        """Take up unfinished work; what was open here stays in its own journal.

        Raises:
            InputError: its base scenario is gone.
            RecipeError: the journal cannot be replayed.
        """
        if work.base_files:
            try:
                files = {path.name: path.read_bytes() for path in work.base_files}
            except OSError as error:
                raise InputError(
                    f"The uploaded files of {work.scenario_id} are gone."
                ) from error
            base = scenario_from_upload(files)
        else:
            base = open_scenario(work.base.source)
        self._let_go_of_journal()
        self.session.take_over(restore(work, base))

    def close(self) -> None:
        """End; edits that were not exported stay in their journal to be offered."""
        self._let_go_of_journal()
        self.session.close(discard=self._is_exported)
