"""Journal of a session on disk, so that no edit is lost if the process is killed.

A folder holds one JSON-lines file per opened scenario that was edited: a header, then
one line per commit and per move along the history, each written at once. Uploaded bytes
are in a folder beside it, and so is a lock that the writing process holds; the system
releases it when the process ends, so a journal without a holder is unfinished work.
"""

import contextlib
import errno
import json
import logging
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Mapping
from io import FileIO
from pathlib import Path
from typing import Any, Final

from filelock import FileLock, Timeout

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import command_to_json
from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.json_values import to_json
from pd_editor.editor.variant import ExportMark, Variant
from pd_editor.scene.scenario import Scenario

JOURNAL_FORMAT: Final = "pd-editor journal"
JOURNAL_VERSION: Final = 1
JOURNAL_SUFFIX: Final = ".journal"
BASE_FILES_SUFFIX: Final = ".base"
LOCK_SUFFIX: Final = ".lock"
MAX_JOURNAL_BYTES: Final = 256 * 2**20
_SAFE_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,199}")
PROBE_S: Final = 0.1
"""Time to wait for a lock that another process may hold for a moment to probe it."""

_logger: Final = logging.getLogger(__name__)


class Journal:
    """Writes the commits of one session; the file is created at the first edit.

    A failing disk does not stop the session: ``problem`` describes it, and lines that
    could not be written wait for the next attempt.
    """

    def __init__(self, folder: Path, *, clock: Callable[[], float] = time.time) -> None:
        """Write journals to a folder, which is created when needed."""
        self._folder = folder
        self._clock = clock
        self._base: Scenario | None = None
        self._base_files: Mapping[str, bytes] = {}
        self._opened_at = 0.0
        self._variant = Variant()
        self._path: Path | None = None
        self._file: FileIO | None = None
        self._size = 0
        """Length of the file up to the last complete line."""
        self._waiting: list[bytes] = []
        """Lines that are not in the file yet."""
        self._lock: FileLock | None = None
        self.problem: str | None = None
        """Reason why edits are not stored at the moment; None while they are."""

    @classmethod
    def resumed(cls, path: Path, *, clock: Callable[[], float]) -> "Journal":
        """Continue an unfinished journal after its last complete line.

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
            release(lock, path)
            raise RecipeError(f"The journal {path.name} is gone.") from error
        journal._size = len(whole_lines(file.read()))
        file.truncate(journal._size)
        file.seek(journal._size)
        journal._path, journal._file, journal._lock = path, file, lock
        return journal

    @property
    def path(self) -> Path | None:
        """The file being written; None before the first edit."""
        return None if self._file is None else self._path

    def start(self, base: Scenario, base_files: Mapping[str, bytes] | None) -> None:
        """Start another journal; the former is released and stays as unfinished work."""
        self.close(discard=False)
        self._base, self._base_files = base, dict(base_files or {})
        self._opened_at = self._clock()
        self._variant = Variant()
        self._path = self._folder / f"{uuid.uuid4().hex}{JOURNAL_SUFFIX}"

    def committed(
        self, command: Command, selection: tuple[str, ...], time_s: float
    ) -> None:
        """Record a committed command and the selection before it."""
        entry = {
            "do": "commit",
            "time_s": time_s,
            "selection": selection,
            **command_to_json(command),
        }
        self._append(entry)

    def moved_to(self, position: int, time_s: float) -> None:
        """Record a move along the branch in force."""
        self._append({"do": "go", "time_s": time_s, "position": position})

    def switched_to(self, number: int, time_s: float) -> None:
        """Record a move to an edit of another branch: one of the commits, from 1 on."""
        self._append({"do": "go", "time_s": time_s, "commit": number})

    def dropped(self, numbers: frozenset[int], time_s: float) -> None:
        """Record the last commits of all branches that are not offered any more."""
        self._append({"do": "drop", "time_s": time_s, "commits": sorted(numbers)})

    def described(self, variant: Variant, time_s: float) -> None:
        """Record name, tags and note; before the first edit they wait for it."""
        if self._file is None and not self._waiting:
            self._variant = variant
            return
        self._append({"do": "describe", "time_s": time_s, "variant": to_json(variant)})

    def exported(self, mark: ExportMark, time_s: float) -> None:
        """Record that the state was exported; without an edit there is nothing to keep."""
        if self._file is not None or self._waiting:
            self._append({"do": "export", "time_s": time_s, "mark": to_json(mark)})

    def retry(self) -> None:
        """Write the waiting lines, if any."""
        if self._waiting:
            self._write_waiting()

    def close(self, *, discard: bool) -> None:
        """Release the file; ``discard`` removes it, because its work is finished."""
        if not discard:
            self.retry()
        if self._file is not None and self._path is not None:
            self._file.close()
            if discard:
                remove_journal(self._path)
            if self._lock is not None:
                release(self._lock, self._path)
        elif self._path is not None:
            remove_journal(self._path)
        self._file = self._lock = self._base = self._path = self.problem = None
        self._waiting.clear()
        self._size = 0

    def _append(self, entry: dict[str, Any]) -> None:
        self._waiting.append(json.dumps(entry).encode() + b"\n")
        self._write_waiting()

    def _write_waiting(self) -> None:
        try:
            self._take_back_deleted()
            if self._file is None:
                self._begin()
            assert self._file is not None
            content = b"".join(self._waiting)
            _write_at(self._file, self._size, content)
        except (OSError, RecipeError) as error:
            reason = getattr(error, "strerror", None) or str(error).rstrip(".")
            problem = f"Edits are not kept on disk: {reason}."
            if problem != self.problem:
                _logger.warning("The journal cannot be written: %s", reason)
            self.problem = problem
            return
        self._size += len(content)
        self._waiting.clear()
        self.problem = None

    def _take_back_deleted(self) -> None:
        """If the file was deleted meanwhile, schedule its content to be written again."""
        file, path = self._file, self._path
        if file is None or path is None or os.fstat(file.fileno()).st_nlink:
            return
        file.seek(0)
        content = file.read(self._size)
        file.close()
        if self._lock is not None:
            release(self._lock, path)
        self._file = self._lock = None
        self._size = 0
        self._waiting.insert(0, content or b"")

    def _begin(self) -> None:
        """Create the file under its lock, with a header as the first line."""
        path = self._path
        assert path is not None, "an edit before a scenario was opened"
        self._folder.mkdir(parents=True, exist_ok=True)
        beside = path.with_suffix(BASE_FILES_SUFFIX)
        for name, content in _safe_names(self._base_files).items():
            beside.mkdir(exist_ok=True)
            (beside / name).write_bytes(content)
        lock = journal_lock(path)
        try:
            self._file = path.open("x+b", buffering=0)
        except OSError:
            release(lock, path)
            raise
        self._lock = lock
        if self._base is not None:
            header = {
                "format": JOURNAL_FORMAT,
                "version": JOURNAL_VERSION,
                "time_s": self._opened_at,
                "base": to_json(self._base.reference),
                "variant": to_json(self._variant),
            }
            self._waiting.insert(0, json.dumps(header).encode() + b"\n")
            self._base = None


def _write_at(file: FileIO, size: int, content: bytes) -> None:
    """Write after the last complete line; an earlier failure may have left a torn one."""
    if size + len(content) > MAX_JOURNAL_BYTES:
        limit = f"{MAX_JOURNAL_BYTES >> 20} MiB"
        raise RecipeError(f"the journal is full ({limit}); export the scenario")
    file.seek(size)
    file.truncate()
    if file.write(content) != len(content):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _safe_names(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Give files names that are valid on any disk, with their original endings."""
    safe: dict[str, bytes] = {}
    for number, (name, content) in enumerate(files.items()):
        if _SAFE_NAME.fullmatch(name) is None or name in safe:
            known = (".zip", ".parquet", ".json")
            suffix = next((one for one in known if name.lower().endswith(one)), "")
            name = f"upload-{number}{suffix}"  # noqa: PLW2901
        safe[name] = content
    return safe


def journal_lock(path: Path, *, timeout_s: float = PROBE_S) -> FileLock:
    """Acquire the exclusive lock of a journal, which any thread may release.

    Raises:
        RecipeError: another process or session holds it.
        OSError: its folder does not exist any more.
    """
    lock = FileLock(path.with_suffix(LOCK_SUFFIX), thread_local=False)
    try:
        lock.acquire(timeout=timeout_s)
    except Timeout:
        raise RecipeError("This work is open in another session already.") from None
    return lock


def release(lock: FileLock, path: Path) -> None:
    """Release a journal's lock; the lock's file goes when the journal has gone."""
    lock.release()
    if not path.exists():
        # Windows does not delete a file that another process has open.
        with contextlib.suppress(OSError):
            path.with_suffix(LOCK_SUFFIX).unlink(missing_ok=True)


def whole_lines(content: bytes) -> bytes:
    """Content without an incomplete last line."""
    return content[: content.rfind(b"\n") + 1]


def remove_journal(path: Path) -> None:
    """Remove a journal and the files beside it, if possible."""
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
    shutil.rmtree(path.with_suffix(BASE_FILES_SUFFIX), ignore_errors=True)
