"""History of commands with their immutable states, for undo and redo."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from operator import itemgetter

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


class EditTree:
    """Numbers of edits as a tree, and the branch of it that is in force.

    The first edit is 1, and 0 is the opened scenario. An edit after an undo begins a
    branch; the edits that were undone stay as a branch of their own.
    """

    def __init__(self) -> None:
        """Make a tree of the opened scenario alone."""
        self._before = [0]
        """For each edit, the number of the one before it."""
        self.path: list[int] = []
        """Edits of the branch in force, the oldest first, undone ones included."""
        self.position = 0
        """Number of edits of the path that are in force."""

    def __len__(self) -> int:
        return len(self._before) - 1

    @property
    def present(self) -> int:
        """The last edit in force; 0 without any."""
        return self.path[self.position - 1] if self.position else 0

    @property
    def tip(self) -> int:
        """The last edit of the branch in force; 0 without any."""
        return self.path[-1] if self.path else 0

    @property
    def tips(self) -> list[int]:
        """The last edit of each branch, the oldest first."""
        return sorted(set(range(1, len(self._before))) - set(self._before))

    def edits_to(self, number: int) -> list[int]:
        """All edits up to one, the oldest first."""
        edits: list[int] = []
        while number:
            edits.append(number)
            number = self._before[number]
        return edits[::-1]

    def forks(self, tips: Iterable[int]) -> dict[int, tuple[int, int]]:
        """For each tip, which earlier one it has most edits in common with, and how many.

        Those with nothing in common with an earlier one leave the opened scenario, 0.
        """
        found: dict[int, tuple[int, int]] = {}
        for tip in tips:
            edits = set(self.edits_to(tip))
            shared = (
                (one, len(edits.intersection(self.edits_to(one)))) for one in found
            )
            found[tip] = max(((0, 0), *shared), key=itemgetter(1))
        return found

    def after(self, number: int) -> list[int]:
        """Edits that were made right after one."""
        return [
            one for one in range(1, len(self._before)) if self._before[one] == number
        ]

    def add(self) -> int:
        """Make an edit after the present one, and return its number."""
        self._before.append(self.present)
        self.path[self.position :] = [len(self)]
        self.position += 1
        return len(self)

    def go_to(self, number: int) -> None:
        """Make an edit the last one in force; what follows it can be redone."""
        if number and number not in self.path:
            self.path = self.edits_to(number)
            while following := self.after(self.path[-1]):
                self.path.append(following[-1])
        self.position = self.path.index(number) + 1 if number else 0


class History:
    """Committed commands as a tree, and a position on the branch that is in force.

    Entries beyond the position are undone. Only the newest ``max_undo`` entries of all
    branches, and of the one in force, keep their states; commands are never forgotten.
    """

    def __init__(self, opened: Snapshot, max_undo: int = 200) -> None:
        """Make an empty history of a state."""
        assert max_undo >= 1
        self._opened, self._max_undo = opened, max_undo
        self.tree = EditTree()
        self.made: list[HistoryEntry] = []
        """All entries, in the order in which they were made."""

    @property
    def entries(self) -> tuple[HistoryEntry, ...]:
        """Entries of the branch in force, the oldest first, undone ones included."""
        return tuple(self.made[number - 1] for number in self.tree.path)

    @property
    def position(self) -> int:
        """Number of entries in force."""
        return self.tree.position

    @property
    def oldest_position(self) -> int:
        """Earliest position that can be restored."""
        made, path = self.made, self.tree.path
        old = (
            at for at in range(len(path), 0, -1) if made[path[at - 1] - 1].after is None
        )
        return next(old, 0)

    def push(self, entry: HistoryEntry) -> None:
        """Add an entry at the position; undone entries become a branch of their own."""
        self.tree.add()
        self.made.append(entry)
        kept = set(self.tree.path[-self._max_undo :])
        for old, one in enumerate(self.made[: -self._max_undo], start=1):
            if old not in kept and one.after is not None:
                self.made[old - 1] = replace(one, before=None, after=None)

    def made_before(self, command: Command) -> int | None:
        """The edit that this very command has made of the present state, if any."""
        made = self.tree.after(self.tree.present)
        same = (one for one in made if self.made[one - 1].command is command)
        return next((one for one in same if self.made[one - 1].after), None)

    def number_at(self, position: int) -> int:
        """Number of the edit at a position; 0 for the opened scenario.

        Raises:
            EditError: there is no such position, or it is too long ago.
        """
        path = self.tree.path
        if not 0 <= position <= len(path):
            raise EditError(
                f"There is no step {position} in the history of {len(path)}."
            )
        if position < self.oldest_position:
            raise EditError(
                f"Step {position} is too long ago; only the last {self._max_undo}"
                " edits can be undone."
            )
        return path[position - 1] if position else 0

    def go_to(self, number: int) -> Snapshot | None:
        """Move to an edit; returns its state, or None if it is the present one.

        Raises:
            EditError: there is no such edit, or it is too long ago.
        """
        tree = self.tree
        if number == tree.present:
            return None
        done = [0, *tree.path[: tree.position]]
        if number in done:
            # With the selection of the moment at which the next edit was made.
            snapshot = self.made[tree.path[done.index(number)] - 1].before
        else:
            snapshot = None
        snapshot = snapshot or self.state_of(number)
        if snapshot is None:
            raise EditError(
                f"There is no edit {number} among the last {self._max_undo}."
            )
        tree.go_to(number)
        return snapshot

    def state_of(self, number: int) -> Snapshot | None:
        """State after an edit; None if it is too long ago, or there is none."""
        if not 0 < number <= len(self.made):
            return None if number else self._opened
        if (after := self.made[number - 1].after) is not None:
            return after
        following = (self.made[one - 1].before for one in self.tree.after(number))
        return next((one for one in following if one is not None), None)
