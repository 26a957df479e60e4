"""Finds unfinished journals on disk, and restores their sessions."""

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import PdEditorError, RecipeError
from pd_editor.base.regular_file import read_regular
from pd_editor.editor.commands import command_from_json
from pd_editor.editor.commands.json_values import from_json
from pd_editor.editor.history import EditTree
from pd_editor.editor.journal import (
    BASE_FILES_SUFFIX,
    JOURNAL_FORMAT,
    JOURNAL_SUFFIX,
    JOURNAL_VERSION,
    MAX_JOURNAL_BYTES,
    Journal,
    journal_lock,
    release,
    remove_journal,
    whole_lines,
)
from pd_editor.editor.recipe import (
    check_version,
    checked_base,
    parsed_json,
    variant_from_json,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import ExportMark, Variant
from pd_editor.scene.base_reference import BaseReference
from pd_editor.scene.scenario import Scenario

__all__ = ["Journal", "UnfinishedWork", "find_unfinished", "restore"]

_logger: Final = logging.getLogger(__name__)
_DOINGS: Final = ("commit", "go", "drop", "describe", "export")
_NO_COMMITS: Final = tuple(f'{{"do": "{one}"'.encode() for one in _DOINGS[1:])
"""How lines begin that commit nothing, also if the rest of them is damaged."""
DAMAGED_SUFFIX: Final = ".damaged"
_looking: Final = threading.Lock()


@dataclass(frozen=True, kw_only=True)
class UnfinishedWork:
    """A journal that no process writes."""

    path: Path
    base: BaseReference
    num_edits: int
    """Number of commands in force at its end; the journal also has undone ones."""
    last_time: float
    """Time of the last edit, in seconds since 1970."""
    variant: Variant
    """Name, tags and note that the user gave."""
    exports: tuple[ExportMark, ...]
    """Exports of its last state; with one the work is finished."""
    base_files: tuple[Path, ...]
    """Uploaded files that the base was opened from; empty if it has a source."""

    @property
    def scenario_id(self) -> str:
        """Id of the edited scenario."""
        return self.base.scenario_id

    def discard(self) -> None:
        """Delete the work permanently.

        Raises:
            RecipeError: another session has resumed it meanwhile.
        """
        try:
            lock = journal_lock(self.path)
        except FileNotFoundError:
            return
        remove_journal(self.path)
        release(lock, self.path)


def find_unfinished(folder: Path) -> list[UnfinishedWork]:
    """Find unfinished work with at least one edit, the newest first.

    Files that a process is writing, or that cannot be read, are left out; the latter
    are logged.
    """
    found: list[UnfinishedWork] = []
    for path in sorted(folder.glob(f"*{JOURNAL_SUFFIX}")):
        try:
            if _is_held(path):
                continue
            state = path.stat()
            work = _summary(path, state.st_mtime_ns, state.st_size)
        except (OSError, RecipeError) as error:
            _logger.warning("The journal %s cannot be read: %s", path.name, error)
            continue
        if work is not None:
            found.append(work)
    return sorted(found, key=lambda work: work.last_time, reverse=True)


@lru_cache(maxsize=1024)
def _summary(path: Path, _changed_ns: int, _size: int) -> UnfinishedWork | None:
    """Summary of a journal; None without any edit."""
    header, entries = _read(path)
    num_edits, exports = _final_state(entries)
    if all(entry.is_remark for entry in entries):
        return None
    damaged = [entry.problem for entry in entries if entry.problem is not None]
    if damaged and all(entry.problem or entry.is_remark for entry in entries):
        raise damaged[0]
    beside = path.with_suffix(BASE_FILES_SUFFIX)
    described = [entry.variant for entry in entries if entry.variant is not None]
    return UnfinishedWork(
        path=path,
        base=header.base,
        num_edits=num_edits,
        last_time=max(entry.time_s for entry in entries),
        variant=described[-1] if described else header.variant,
        exports=exports,
        base_files=tuple(sorted(beside.iterdir())) if os.path.isdir(beside) else (),
    )


def restore(
    work: UnfinishedWork,
    base: Scenario,
    *,
    clock: Callable[[], float] = time.time,
    max_undo: int = 200,
) -> EditorSession:
    """Restore a session from its journal, which it continues.

    ``base`` is the scenario opened again, from ``work.base`` or ``work.base_files``.
    Lines that are damaged or do not apply are passed over; ``session.lost_edits`` tells
    of them, and a new journal takes the place of the damaged one, which is kept.

    Raises:
        RecipeError: the base differs, no edit applies, or another session has resumed
            the work meanwhile.
    """
    base = checked_base(work.base, base)
    journal = Journal.resumed(work.path, clock=clock)
    try:
        replay_clock = _ReplayClock(live=clock)
        session = EditorSession(base, clock=replay_clock, max_undo=max_undo)
        header, entries = _read(work.path)
        lost = _replay(session, replay_clock, header, entries)
        if lost and not session.entries:
            raise lost[0]
    except PdEditorError:
        journal.close(discard=False)
        raise
    if not lost:
        session.continue_journal(journal)
        return session
    # Positions in the damaged journal count lines that are lost.
    session = EditorSession(
        base,
        clock=replay_clock,
        journal=Journal(work.path.parent, clock=clock),
        max_undo=max_undo,
        base_files={path.name: path.read_bytes() for path in work.base_files},
    )
    _replay(session, replay_clock, header, entries)
    journal.close(discard=False)
    kept = work.path.with_suffix(DAMAGED_SUFFIX)
    with contextlib.suppress(OSError):
        work.path.replace(kept)
    session.lost_edits = (
        f" {len(lost)} of the {len(entries)} lines of its journal could not be replayed,"
        f" the first because: {lost[0]} The whole journal is kept as {kept.name}."
    )
    _logger.warning("Of %s:%s", work.scenario_id, session.lost_edits)
    return session


def _replay(
    session: EditorSession,
    clock: "_ReplayClock",
    header: "_Header",
    entries: "list[_Entry]",
) -> list[RecipeError]:
    """Replay a journal, and return why lines of it are lost."""
    session.describe(header.variant)
    lost: list[RecipeError] = []
    tree, numbers = EditTree(), [0]
    """Commits of the journal, and the last edit of the session after each."""
    for entry in entries:
        clock.recorded_s = entry.time_s
        try:
            entry.follow(tree)
            _redo(session, entry, tree, numbers)
        except RecipeError as error:
            lost.append(error)
        if entry.is_commit:
            numbers.append(session.present)
    clock.recorded_s = None
    return lost


@dataclass(frozen=True, kw_only=True)
class _Header:
    base: BaseReference
    time_s: float
    variant: Variant


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """A line of a journal, with its command not yet decoded."""

    number: int
    time_s: float
    position: int | None = None
    """Position that the branch in force was moved to."""
    commit: int | None = None
    """Commit of another branch that was moved to."""
    dropped: frozenset[int] | None = None
    """Last commits of all branches that were dropped."""
    selection: tuple[str, ...] = ()
    command: dict[str, Any] | None = None
    variant: Variant | None = None
    mark: ExportMark | None = None
    problem: RecipeError | None = None
    """What is wrong with a damaged line."""
    is_commit: bool = False

    @property
    def is_remark(self) -> bool:
        """Whether it changes nothing of the scenario."""
        return not self.is_commit and self.position is None and self.commit is None

    def follow(self, tree: EditTree) -> None:
        """Take part in a tree of the journal's commits, damaged ones included.

        Raises:
            RecipeError: it moves to what is not there.
        """
        if self.is_commit:
            tree.add()
        elif self.position is not None and 0 <= self.position <= len(tree.path):
            tree.position = self.position
        elif self.commit is not None and 0 <= self.commit <= len(tree):
            tree.go_to(self.commit)
        elif not self.is_remark:
            raise RecipeError(
                f"Line {self.number} of the journal: There is no such step."
            )


@dataclass
class _ReplayClock:
    """Clock that returns recorded times during a replay, then the time of a live clock."""

    live: Callable[[], float]
    recorded_s: float | None = None

    def __call__(self) -> float:
        return self.live() if self.recorded_s is None else self.recorded_s


def _redo(
    session: EditorSession, entry: _Entry, tree: EditTree, numbers: list[int]
) -> None:
    where = f"Line {entry.number} of the journal"
    try:
        if entry.problem is not None:
            raise entry.problem
        if entry.variant is not None:
            if entry.variant == session.variant:
                session.take_name_back()
            session.describe(entry.variant)
            return
        if entry.mark is not None:
            session.mark_exported(entry.mark)
            return
        if entry.dropped is not None:
            known = dict(enumerate(numbers))
            session.drop_branches(known.get(one, -1) for one in entry.dropped)
            return
        if not entry.is_commit:
            session.go_to(numbers[tree.present])
            return
        there = session.scenario.agents.row_of
        session.select(name for name in entry.selection if name in there)
        session.apply(command_from_json(entry.command, where))
    except RecipeError:
        raise
    except PdEditorError as error:
        raise RecipeError(f"{where}: {error}") from error


def _is_held(path: Path) -> bool:
    """Whether a living process, this one included, writes the journal."""
    # Probing acquires the lock for a moment, which another probe must tolerate.
    with _looking:
        try:
            release(journal_lock(path, timeout_s=0), path)
        except RecipeError:
            return True
    return False


def _read(path: Path) -> tuple[_Header, list[_Entry]]:
    """Read header and lines, without an incomplete last line."""
    content = read_regular(path, max_bytes=MAX_JOURNAL_BYTES, error=RecipeError)
    lines = whole_lines(content).splitlines()
    if not lines:
        raise RecipeError("The journal ends within its first line.")
    head = parsed_json(lines[0], "The journal's first line")
    if not isinstance(head, dict) or head.get("format") != JOURNAL_FORMAT:
        raise RecipeError(f'This is not a journal; its format is "{JOURNAL_FORMAT}".')
    check_version(head.get("version"), JOURNAL_VERSION, "journal")
    header = _Header(
        base=from_json(BaseReference, head.get("base"), "The journal's base"),
        time_s=from_json(float, head.get("time_s"), "The journal's time"),
        variant=variant_from_json(head.get("variant", {})),
    )
    entries: list[_Entry] = []
    num_damaged = 0
    for number, line in enumerate(lines[1:], start=2):
        try:
            entries.append(_entry(number, line))
        except RecipeError as error:
            num_damaged += 1
            # A file with more damaged lines is no journal.
            if num_damaged > 1000:
                raise
            time_s = entries[-1].time_s if entries else header.time_s
            commits = not line.startswith(_NO_COMMITS)
            entries.append(
                _Entry(number=number, time_s=time_s, problem=error, is_commit=commits)
            )
    return header, entries


def _entry(number: int, line: bytes) -> _Entry:
    where = f"Line {number} of the journal"
    data = parsed_json(line, where)
    if not isinstance(data, dict) or data.get("do") not in _DOINGS:
        raise RecipeError(f"{where} is no commit, move, description or export.")
    time_s = from_json(float, data.get("time_s"), f"{where}: its time")
    if data["do"] == "go" and "commit" in data:
        commit = from_json(int, data["commit"], f"{where}: its commit")
        return _Entry(number=number, time_s=time_s, commit=commit)
    if data["do"] == "go":
        position = from_json(int, data.get("position"), f"{where}: its position")
        return _Entry(number=number, time_s=time_s, position=position)
    if data["do"] == "drop":
        commits = from_json(tuple[int, ...], data.get("commits"), f"{where}: commits")
        return _Entry(number=number, time_s=time_s, dropped=frozenset(commits))
    if data["do"] == "describe":
        variant = variant_from_json(data.get("variant"))
        return _Entry(number=number, time_s=time_s, variant=variant)
    if data["do"] == "export":
        mark = from_json(ExportMark, data.get("mark"), f"{where}: its export")
        return _Entry(number=number, time_s=time_s, mark=mark)
    names = from_json(tuple[str, ...], data.get("selection"), f"{where}: selection")
    command = {
        key: value
        for key, value in data.items()
        if key not in ("do", "time_s", "selection")
    }
    return _Entry(
        number=number, time_s=time_s, selection=names, command=command, is_commit=True
    )


def _final_state(entries: list[_Entry]) -> tuple[int, tuple[ExportMark, ...]]:
    """Number of edits in force at the end, and the exports of that state."""
    tree, is_whole = EditTree(), [True]
    exports: dict[int, list[ExportMark]] = {}
    for entry in entries:
        with contextlib.suppress(RecipeError):
            entry.follow(tree)
        if entry.mark is not None:
            exports.setdefault(tree.present, []).append(entry.mark)
        elif entry.is_commit:
            is_whole.append(entry.problem is None)
    num_edits = sum(is_whole[one] for one in tree.edits_to(tree.present))
    return num_edits, tuple(exports.get(tree.present, ()))
