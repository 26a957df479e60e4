"""What one browser tab works on; it outlives the tab's connection."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
from pd_editor.editor.variant import short_id
from pd_editor.errors import InputError
from pd_editor.exporters.bundle import zip_files
from pd_editor.scenario_store import export_into, exported_files, open_scenario
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.playback import Playback
from pd_editor.viewer.state.session_shelf import (
    SessionShelf,
    ShelvedSession,
    is_same_base,
)
from pd_editor.viewer.state.view_memory import ViewMemory

SEARCH_STEP: Final = 4
"""Scenario folders looked at before the clock is looked at again."""
SEARCH_TURN_S: Final = 0.008
"""How long a search goes on between two messages of the user or frames."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptWork:
    """Unfinished work of one scenario, to go on with or to discard."""

    scenario_id: str
    name: str
    """The name that the user gave, or a proposed one; empty if there is none."""
    num_edits: int
    last_time: float
    """When the last edit was made, in seconds since 1970."""
    place: ShelvedSession | UnfinishedWork
    """Where it is: in this workspace, or in a journal on disk."""


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
        self.tell: Callable[[str, str], None] = lambda _title, _body: None
        """Shows the user a few words and a sentence; set by the tab that is open."""
        self._shelf = SessionShelf(journals)
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
        """Open a scenario, or go on where it was left; what was open is kept."""
        self.session.commit_gesture()
        if self.session.entries and is_same_base(scenario, self.session.base):
            self.tell(
                f"{short_id(scenario.scenario_id)} is open already",
                f"It has {_edits(self.session.state.position)}; go back in the History "
                "tab to begin anew.",
            )
            return
        kept = self._shelf.take(scenario)
        if kept is None:
            session = EditorSession(
                scenario, journal=Journal(self._journals), base_files=base_files
            )
            kept = ShelvedSession(session=session, exported=None)
        self._exchange(kept)

    def _exchange(self, taken: ShelvedSession) -> None:
        """Go on with a session; the one that was open goes to the shelf."""
        left = ShelvedSession(session=taken.session, exported=self._exported)
        self._exported = taken.exported
        self.session.exchange(taken.session)
        if left.session.entries:
            name = short_id(left.session.base.scenario_id)
            count = left.session.state.position
            self.tell(
                f"{_edits(count)} of {name} {'is' if count == 1 else 'are'} kept",
                "Open it again to continue.",
            )
        self._shelf.put(left)
        if self.session.entries:
            self.tell(
                f"Back to {short_id(self.session.base.scenario_id)}",
                f"It goes on with its {_edits(self.session.state.position)}.",
            )

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

    def unfinished_work(self) -> list[KeptWork]:
        """Edited scenarios that are not open and not exported, the newest first."""
        here = [
            KeptWork(
                scenario_id=left.session.base.scenario_id,
                name=left.session.name,
                num_edits=left.session.state.position,
                last_time=left.session.entries[-1].time_s,
                place=left,
            )
            for left in self._shelf.live
            if not left.is_exported
        ]
        stored = [
            KeptWork(
                scenario_id=work.scenario_id,
                name=work.variant.name,
                num_edits=work.num_edits,
                last_time=work.last_time,
                place=work,
            )
            for work in find_unfinished(self._journals)
        ]
        return sorted(here + stored, key=lambda one: one.last_time, reverse=True)

    def resume(self, work: KeptWork) -> None:
        """Go on with unfinished work; what was open is kept.

        Raises:
            InputError: its base scenario is gone.
            RecipeError: the journal cannot be replayed, or is open elsewhere.
        """
        if isinstance(work.place, UnfinishedWork):
            self.restore(work.place)
        elif work.place in self._shelf.live:
            self._shelf.remove(work.place)
            self._exchange(work.place)

    def discard(self, work: KeptWork) -> None:
        """Forget unfinished work for good.

        Raises:
            RecipeError: it is open in another session.
        """
        if isinstance(work.place, UnfinishedWork):
            work.place.discard()
        elif work.place in self._shelf.live:
            self._shelf.remove(work.place)
            work.place.session.close(discard=True)

    def retry_journals(self) -> None:
        """Keep on disk what could not be kept there so far, if anything."""
        self.session.retry_journal()
        self._shelf.retry_journals()

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
        session = restore(work, base)
        self._exchange(ShelvedSession(session=session, exported=None))

    def close(self) -> None:
        """End; edits that were not exported stay in their journal to be offered."""
        self.session.commit_gesture()
        self.session.close(discard=self._is_exported)
        self._shelf.close()


def _edits(count: int) -> str:
    return f"{count} edit{'s' if count != 1 else ''}"
