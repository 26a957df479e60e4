"""History of commands with their immutable states, for undo and redo."""

from dataclasses import dataclass, replace

from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import Command
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """A scenario with its selection."""

    scenario: Scenario
    selection: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class HistoryEntry:
    """A committed command with the states before and after it."""

    command: Command
    time_s: float
    """Time of the commit, in seconds since 1970."""
    before: Snapshot | None
    after: Snapshot | None
    """States before and after; None if the entry is too old to be undone."""
    label: str
    """Short text for a list."""


class History:
    """Committed commands and a position among them; entries beyond it are undone.

    Only the newest ``max_undo`` entries keep their states; the list of commands is
    never truncated at its start.
    """

    def __init__(self, max_undo: int = 200) -> None:
        """Make an empty history."""
        assert max_undo >= 1
        self._max_undo = max_undo
        self._entries: list[HistoryEntry] = []
        self._position = 0
        self._oldest = 0

    @property
    def entries(self) -> tuple[HistoryEntry, ...]:
        """All entries, the oldest first, undone ones included."""
        return tuple(self._entries)

    @property
    def position(self) -> int:
        """Number of entries in force."""
        return self._position

    @property
    def oldest_position(self) -> int:
        """Earliest position that can be restored."""
        return self._oldest

    def __len__(self) -> int:
        return len(self._entries)

    def push(self, entry: HistoryEntry) -> None:
        """Add an entry at the position; undone entries are dropped."""
        del self._entries[self._position :]
        self._entries.append(entry)
        self._position += 1
        while self._oldest < len(self._entries) - self._max_undo:
            old = self._entries[self._oldest]
            self._entries[self._oldest] = replace(old, before=None, after=None)
            self._oldest += 1

    def go_to(self, position: int) -> Snapshot | None:
        """Move to a position; returns its state, or None if it is the present one.

        Raises:
            EditError: there is no such position, or it is too long ago.
        """
        if not 0 <= position <= len(self._entries):
            raise EditError(
                f"There is no step {position} in the history of {len(self._entries)}."
            )
        if position < self._oldest:
            raise EditError(
                f"Step {position} is too long ago; only the last {self._max_undo}"
                " edits can be undone."
            )
        if position == self._position:
            return None
        if position < self._position:
            snapshot = self._entries[position].before
        else:
            snapshot = self._entries[position - 1].after
        assert snapshot is not None
        self._position = position
        return snapshot
