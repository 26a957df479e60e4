"""The work of a session as it grows on disk, so that a kill loses nothing.

A folder holds one JSON-lines file per opened scenario that was edited: a header, then
one line per commit and per move along the history, each handed to the operating
system at once. Uploaded bytes lie in a folder beside it, and so does a lock that the
writing process holds; the system drops it when the process ends, however it ends, so a
journal without a holder is unfinished work.
"""

import contextlib
import errno
import json
import logging
import os
import shutil
import time
import uuid
from collections.abc import Callable, Mapping
from io import FileIO
from pathlib import Path
from typing import Any, Final

from filelock import FileLock, Timeout

from pd_editor.editor.command import Command
from pd_editor.editor.commands import command_to_json
from pd_editor.editor.json_values import to_json
from pd_editor.editor.recipe import BaseReference
from pd_editor.errors import InputError, RecipeError
from pd_editor.scene.scenario import Scenario

JOURNAL_FORMAT: Final = "pd-editor journal"
JOURNAL_VERSION: Final = 1
JOURNAL_SUFFIX: Final = ".journal"
BASE_FILES_SUFFIX: Final = ".base"
LOCK_SUFFIX: Final = ".lock"
PROBE_S: Final = 0.1
"""How long a lock is waited for, in case somebody only looks whether it is held."""

_logger: Final = logging.getLogger(__name__)


class Journal:
    """Writes what one session commits; a file appears with the first edit.

    A disk that fails does not stop the session: it is logged, and ``problem`` says so.
    """

    def __init__(self, folder: Path, *, clock: Callable[[], float] = time.time) -> None:
        """Keep journals in a folder, which is made when needed."""
        self._folder = folder
        self._clock = clock
        self._base: Scenario | None = None
        self._base_files: Mapping[str, bytes] = {}
        self._opened_at = 0.0
        self._file: FileIO | None = None
        self._lock: FileLock | None = None
        self.problem: str | None = None
        """Why edits are not kept at the moment; None while they are."""

    @classmethod
    def resumed(cls, path: Path, *, clock: Callable[[], float]) -> "Journal":
        """Go on writing an unfinished journal, from its last whole line.

        Raises:
            RecipeError: another process, or another session, writes it.
        """
        journal = cls(path.parent, clock=clock)
        try:
            lock = journal_lock(path)
        except OSError as error:
            raise RecipeError(f"The journal {path.name} is gone.") from error
        try:
            file = path.open("r+b", buffering=0)
        except OSError as error:
            let_go(lock, path)
            raise RecipeError(f"The journal {path.name} is gone.") from error
        file.truncate(len(whole_lines(file.read())))
        file.seek(0, os.SEEK_END)
        journal._file, journal._lock = file, lock
        return journal

    @property
    def path(self) -> Path | None:
        """The file being written; None before the first edit."""
        return None if self._file is None else Path(self._file.name)

    def start(self, base: Scenario, base_files: Mapping[str, bytes] | None) -> None:
        """Begin another journal; the former is let go and stays as unfinished work.

        Raises:
            InputError: a file of the base has a path instead of a name.
        """
        for name in base_files or {}:
            if name in ("", ".", "..") or "/" in name or "\\" in name or "\0" in name:
                raise InputError(f"The file name {name!r} must be plain, not a path.")
        self.close(discard=False)
        self._base, self._base_files = base, dict(base_files or {})
        self._opened_at = self._clock()
        self.problem = None

    def committed(
        self, command: Command, selection: tuple[str, ...], time_s: float
    ) -> None:
        """Keep a committed command, and what was selected before it."""
        entry = {
            "do": "commit",
            "time_s": time_s,
            "selection": selection,
            **command_to_json(command),
        }
        self._append(entry)

    def moved_to(self, position: int, time_s: float) -> None:
        """Keep that the history was gone along."""
        self._append({"do": "go", "time_s": time_s, "position": position})

    def close(self, *, discard: bool) -> None:
        """Let go of the file; ``discard`` removes it, its work being finished."""
        if self._file is None:
            return
        path = Path(self._file.name)
        self._file.close()
        if discard:
            remove_journal(path)
        if self._lock is not None:
            let_go(self._lock, path)
        self._file = self._lock = None
        self._base = None

    def _append(self, entry: dict[str, Any]) -> None:
        if self.problem is not None:
            return
        line = json.dumps(entry).encode() + b"\n"
        try:
            if self._file is None:
                self._file, self._lock, header = self._begun()
                line = header + line
            _write_whole(self._file, line)
        except OSError as error:
            _logger.exception("The journal cannot be written")
            self.problem = f"Edits are not kept on disk: {error.strerror or error}."

    def _begun(self) -> tuple[FileIO, FileLock, bytes]:
        """A new file under lock, and the header to begin it with."""
        assert self._base is not None, "an edit before a scenario was opened"
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{uuid.uuid4().hex}{JOURNAL_SUFFIX}"
        for name, content in self._base_files.items():
            beside = path.with_suffix(BASE_FILES_SUFFIX)
            beside.mkdir(exist_ok=True)
            (beside / name).write_bytes(content)
        self._base_files = {}
        lock = journal_lock(path)
        try:
            file = path.open("xb", buffering=0)
        except OSError:
            let_go(lock, path)
            raise
        header = {
            "format": JOURNAL_FORMAT,
            "version": JOURNAL_VERSION,
            "time_s": self._opened_at,
            "base": to_json(BaseReference.of(self._base)),
        }
        return file, lock, json.dumps(header).encode() + b"\n"


def _write_whole(file: FileIO, line: bytes) -> None:
    if file.write(line) != len(line):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def journal_lock(path: Path, *, timeout_s: float = PROBE_S) -> FileLock:
    """Take the exclusive lock of a journal, which any thread may let go.

    Raises:
        RecipeError: somebody else holds it.
        OSError: its folder is gone.
    """
    lock = FileLock(path.with_suffix(LOCK_SUFFIX), thread_local=False)
    try:
        lock.acquire(timeout=timeout_s)
    except Timeout:
        raise RecipeError("This work is open in another session already.") from None
    return lock


def let_go(lock: FileLock, path: Path) -> None:
    """Release a journal's lock; the lock's file goes when the journal has gone."""
    lock.release()
    if not path.exists():
        # Windows keeps a file that somebody is looking at.
        with contextlib.suppress(OSError):
            path.with_suffix(LOCK_SUFFIX).unlink(missing_ok=True)


def whole_lines(content: bytes) -> bytes:
    """The content without a last line that was torn while it was written."""
    return content[: content.rfind(b"\n") + 1]


def remove_journal(path: Path) -> None:
    """Remove a journal and the files beside it."""
    path.unlink(missing_ok=True)
    shutil.rmtree(path.with_suffix(BASE_FILES_SUFFIX), ignore_errors=True)
