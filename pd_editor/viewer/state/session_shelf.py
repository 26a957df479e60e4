"""Work of one visitor that is not open at the moment, in memory and on disk."""

import contextlib
import json
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from filelock import FileLock

from pd_editor.base.errors import InputError, RecipeError
from pd_editor.base.regular_file import json_value, read_regular, write_whole
from pd_editor.editor.journal import Journal
from pd_editor.editor.library.library import KEPT_S, LIBRARY_NAME, Library
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import UnfinishedWork, find_unfinished, restore
from pd_editor.experiments.scene_index.index_file import index_place
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.index_run import IndexRun

MAX_LIVE: Final = 4
"""Number of sessions in memory; older ones are restored from their journals."""
REJECTED_NAME: Final = "rejected.json"


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptWork:
    """Unfinished work of one scenario, to continue or to discard."""

    scenario_id: str
    name: str
    """The name that the user gave, or a proposed one; empty if there is none."""
    num_edits: int
    last_time: float
    """Time of the last edit, in seconds since 1970."""
    place: EditorSession | UnfinishedWork
    """The session in memory, or the journal on disk."""


class SessionShelf:
    """Library and left sessions of one visitor, whose tabs share them.

    Opening the scenario of a left session resumes it. Journals of exported work stay on
    disk as long as the shelf exists, and those of a killed process for a day.
    """

    def __init__(self, folder: Path, library: Path | None = None) -> None:
        """Use a folder, created when needed, and a library; None: one in the folder."""
        self.folder = folder
        self.journals = folder / "journals"
        self.library = Library(library or folder / LIBRARY_NAME)
        self.index_run = IndexRun(self.library, index_place(self.library.root, folder))
        """Reads what happens in scenarios of the library."""
        self.rejected = Rejected(folder)
        self._live: list[EditorSession] = []
        self._stored: set[Path] = set()
        """Journals of this shelf's sessions that are no longer in memory."""
        self._changes = 0
        self._lock = threading.Lock()
        self._discard_finished(older_than_s=KEPT_S)

    def new_journal(self) -> Journal:
        """Journal for a session that is opened."""
        return Journal(self.journals)

    @property
    def live(self) -> tuple[EditorSession, ...]:
        """Left sessions in memory, the most recent one last."""
        with self._lock:
            return tuple(self._live)

    def stamp(self) -> tuple[int, ...]:
        """Numbers that change when any tab changes what is unfinished."""
        try:
            on_disk = self.journals.stat().st_mtime_ns
        except OSError:
            on_disk = 0
        return self._changes, on_disk, self.library.stamp()

    def is_finished(self, work: EditorSession | UnfinishedWork) -> bool:
        """Whether the last state was exported, or is in the library."""
        is_open = isinstance(work, EditorSession)
        marks = work.exports_of_state if is_open else work.exports
        return any(one.saved_at is None or self.library.marked(one) for one in marks)

    def put(self, left: EditorSession) -> None:
        """Store a session; one without edits is closed."""
        if not left.entries:
            left.close(discard=True)
            return
        with self._lock:
            self._changes += 1
            self._live.append(left)
            for old in self._live[:-MAX_LIVE]:
                path = old.journal_path
                if path is None or old.journal_problem is not None:
                    # This is the only copy.
                    continue
                self._live.remove(old)
                self._stored.add(path)
                old.close()

    def take(self, base: Scenario) -> EditorSession | None:
        """Remove and return the most recent session on a scenario, also an earlier run's.

        Work on disk that was exported comes back only if it was left in this shelf.
        """
        with self._lock:
            for left in reversed(self._live):
                if is_same_base(left.base, base):
                    self._live.remove(left)
                    self._changes += 1
                    return left
        for work in find_unfinished(self.journals):
            is_own = work.path in self._stored or not self.is_finished(work)
            if is_own and work.base.contents == base.reference.contents:
                # What cannot be restored stays in the list, which tells the reason.
                with contextlib.suppress(RecipeError):
                    return self.restored(work, base)
        return None

    def restored(self, work: UnfinishedWork, base: Scenario) -> EditorSession:
        """The session of a journal.

        Raises:
            RecipeError: it cannot be replayed on this base, or is open elsewhere.
        """
        session = restore(work, base)
        self._stored.discard(work.path)
        self._changes += 1
        return session

    def claim(self, left: EditorSession) -> bool:
        """Remove a session, which the caller continues or closes; false if it is gone."""
        with self._lock:
            if left not in self._live:
                return False
            self._live.remove(left)
            self._changes += 1
            return True

    def unfinished(self) -> list[KeptWork]:
        """Edited scenarios that are not open and not exported, the newest first."""
        here = [
            KeptWork(
                scenario_id=left.base.scenario_id,
                name=left.name,
                num_edits=left.state.position,
                last_time=left.entries[-1].time_s,
                place=left,
            )
            for left in self.live
            if not self.is_finished(left)
        ]
        stored = [
            KeptWork(
                scenario_id=work.scenario_id,
                name=work.variant.name,
                num_edits=work.num_edits,
                last_time=work.last_time,
                place=work,
            )
            for work in find_unfinished(self.journals)
            if not self.is_finished(work)
        ]
        return sorted(here + stored, key=lambda one: one.last_time, reverse=True)

    def discard(self, work: KeptWork) -> None:
        """Delete unfinished work permanently.

        Raises:
            RecipeError: it is open in another session.
        """
        if isinstance(work.place, UnfinishedWork):
            work.place.discard()
            self._changes += 1
        elif self.claim(work.place):
            work.place.close(discard=True)

    def retry_journals(self) -> None:
        """Write edits to disk that could not be written before."""
        with self._lock:
            for left in self._live:
                left.retry_journal()

    def close(self) -> None:
        """End all sessions; edits that were not exported stay in their journals."""
        self.index_run.close()
        with self._lock:
            for left in self._live:
                left.close(discard=self.is_finished(left))
            self._live.clear()
        if self._stored:
            self._discard_finished(self._stored)
        self._stored = set()

    def _discard_finished(
        self, paths: set[Path] | None = None, *, older_than_s: float = 0.0
    ) -> None:
        """Delete journals of exported work: some, or all old ones."""
        for work in find_unfinished(self.journals):
            is_old = time.time() - work.last_time > older_than_s
            is_meant = is_old if paths is None else work.path in paths
            if is_meant and self.is_finished(work):
                # Another session may just have taken it up.
                with contextlib.suppress(RecipeError):
                    work.discard()


def is_same_base(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios were opened from the same contents under the same id."""
    return one.reference.contents == other.reference.contents


class Rejected:
    """Places of rejected scenes, in a file that tabs and programs share."""

    def __init__(self, folder: Path) -> None:
        """Use the file in a folder, which is made when needed."""
        self._path = folder / REJECTED_NAME
        self._known: tuple[int, frozenset[str]] = -1, frozenset()

    def stamp(self) -> int:
        """A number that changes with the file."""
        try:
            return self._path.stat().st_mtime_ns
        except OSError:
            return 0

    def places(self) -> frozenset[str]:
        """Places of all of them; none of a file that is none of ours."""
        stamp = self.stamp()
        if stamp != self._known[0]:
            found: object = None
            with contextlib.suppress(InputError, ValueError):
                found = json_value(read_regular(self._path, max_bytes=16 << 20))
            listed = found if isinstance(found, list) else []
            places = frozenset(one for one in listed if isinstance(one, str))
            self._known = stamp, places
        return self._known[1]

    def toggle(self, place: str) -> bool:
        """Reject a scene, or take that back; returns whether it is rejected now.

        Raises:
            ExportError: the file cannot be written.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(self._path.with_suffix(".lock")):
            self._known = -1, frozenset()
            places = self.places() ^ {place}
            write_whole(self._path, json.dumps(sorted(places)).encode())
        return place in places
