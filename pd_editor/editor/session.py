"""Editing session: the open scenario, its selection and its history."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC
from operator import is_
from pathlib import Path

from pd_editor.base.errors import EditError, PdEditorError, RecipeError
from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.commands.roll_out import BeginAt, begun_like
from pd_editor.editor.history import History, HistoryEntry, Snapshot
from pd_editor.editor.journal import Journal
from pd_editor.editor.recipe import MAX_COMMANDS, Recipe, checked_base, moment
from pd_editor.editor.variant import ExportMark, Variant, proposed_name
from pd_editor.scene.formats.player import Player
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionState:
    """State of a session for listeners, whose parts are compared by identity."""

    base: Scenario
    """The opened scenario; it changes if another one is opened."""
    scenario: Scenario
    selection: tuple[str, ...]
    position: int
    """Number of commands in force."""
    num_entries: int
    """Number of commands on the branch in force, undone ones included."""
    tip: int
    """Number of the last of them among all edits; 0 without any."""
    is_previewing: bool
    """Whether the scenario is the preview of an unfinished gesture."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch:
    """A state after which nothing was edited, or the opened scenario."""

    number: int
    """Of its last edit among all edits of the session; 0 for the opened scenario."""
    scenario: Scenario
    entries: tuple[HistoryEntry, ...]
    fork: tuple[int, int]
    """Number of the branch that it leaves, and how many edits it has in common with it."""
    variant: Variant
    """Its name, tags and note."""


Listener = Callable[[SessionState, SessionState], None]


class EditorSession:
    """An open scenario with its selection and history.

    Not thread-safe. Each method either succeeds or raises and changes nothing. Listeners
    are called after each change.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        clock: Callable[[], float] = time.time,
        journal: Journal | None = None,
        max_undo: int = 200,
        base_files: Mapping[str, bytes] | None = None,
    ) -> None:
        """Open a scenario, the base of all edits, of which ``max_undo`` can be undone.

        The clock returns seconds since 1970. ``base_files`` are the scenario's files if
        it cannot be opened from its source.
        """
        self._clock = clock
        self._journal = journal
        self._max_undo = max_undo
        self._listeners: list[Listener] = []
        self._base = scenario
        self._now = Snapshot(scenario=scenario, selection=())
        self._history = History(self._now, max_undo)
        self._variants: dict[int, Variant] = {}
        """What is said of branches that are not in force, by their last edits."""
        self._dropped = frozenset[int]()
        self._original: tuple[tuple[object, ...], Scenario] | None = None
        self._gesture_start: Snapshot | None = None
        self._previewed: Command | None = None
        self._variant = Variant()
        self._exports: tuple[tuple[Scenario, ExportMark], ...] = ()
        self._numbered: tuple[tuple[Scenario, str, str], ...] = ()
        """States written under another name than the user's, which was taken, and both names."""
        self._replayed: tuple[str, tuple[Command, ...]] = ("", ())
        """Name that the program gave to the result of a recipe, with its commands."""
        self.lost_edits = ""
        """What of its journal could not be restored, after a space; empty: nothing."""
        if journal is not None:
            journal.start(scenario, base_files)

    @classmethod
    def from_recipe(
        cls, recipe: Recipe, base: Scenario, *, journal: Journal | None = None
    ) -> "EditorSession":
        """Open a session and apply a recipe's commands to its base.

        Raises:
            RecipeError: the base differs, or a command does not apply.
        """
        session = cls(checked_base(recipe.base, base), journal=journal)
        try:
            for number, command in enumerate(recipe.commands, start=1):
                try:
                    session.apply(command)
                except PdEditorError as error:
                    raise RecipeError(
                        f"Entry {number} ({command.label}): {error}"
                    ) from error
        except RecipeError:
            session.close(discard=True)
            raise
        variant = recipe.variant
        if variant.is_proposed:
            session._replayed = (variant.name, session.commands_in_force)
        if variant.is_proposed or variant.name == session.name:
            # It goes on following the edits.
            variant = replace(variant, name="", is_proposed=False)
        session.describe(variant)
        return session

    @property
    def state(self) -> SessionState:
        """State of the session as a value."""
        return SessionState(
            base=self._base,
            scenario=self._now.scenario,
            selection=self._now.selection,
            position=self._history.position,
            num_entries=len(self._history.tree.path),
            tip=self._history.tree.tip,
            is_previewing=self._previewed is not None,
        )

    @property
    def base(self) -> Scenario:
        """The opened scenario."""
        return self._base

    @property
    def original(self) -> Scenario:
        """The opened scenario, from the moment on that is the current one by now."""
        moments = [one for one in self.commands_in_force if isinstance(one, BeginAt)]
        known = (self._base, *moments)
        if not moments:
            return self._base
        if self._original is None or not _same(self._original[0], known):
            self._original = known, begun_like(self._base, moments)
        return self._original[1]

    @property
    def scenario(self) -> Scenario:
        """The current scenario, which may be a preview."""
        return self._now.scenario

    @property
    def committed_scenario(self) -> Scenario:
        """The current scenario without the preview of an unfinished gesture."""
        start = self._gesture_start
        return self._now.scenario if start is None else start.scenario

    @property
    def selection(self) -> tuple[str, ...]:
        """Ids of the selected agents."""
        return self._now.selection

    @property
    def entries(self) -> tuple[HistoryEntry, ...]:
        """Commands of the branch in force, the oldest first, undone ones included."""
        return self._history.entries

    @property
    def all_entries(self) -> tuple[HistoryEntry, ...]:
        """Commands of all branches, in the order in which they were committed."""
        return tuple(self._history.made)

    @property
    def branch_tips(self) -> tuple[int, ...]:
        """Last edits of the branches that can be switched to, after 0, the opened scenario."""
        history, tip = self._history, self._history.tree.tip
        offered = (one for one in history.tree.tips if history.made[one - 1].after)
        return 0, *(one for one in offered if one == tip or one not in self._dropped)

    @property
    def branches(self) -> tuple[Branch, ...]:
        """The opened scenario and the branches that can be switched to, the oldest first."""
        history, tree = self._history, self._history.tree
        variants = self._variants | {tree.tip: self._variant}
        branches: list[Branch] = []
        forks = tree.forks(self.branch_tips)
        for tip in self.branch_tips:
            state = history.state_of(tip)
            assert state is not None
            edits = tree.edits_to(tip)
            branch = Branch(
                number=tip,
                scenario=state.scenario,
                entries=tuple(history.made[one - 1] for one in edits),
                variant=variants.get(tip, Variant()),
                fork=forks[tip],
            )
            branches.append(branch)
        return tuple(branches)

    @property
    def present(self) -> int:
        """Number of the last edit in force among all edits; 0 without any."""
        return self._history.tree.present

    @property
    def dropped(self) -> frozenset[int]:
        """Last edits of branches that are not offered any more, by number."""
        return self._dropped

    @property
    def commands_in_force(self) -> tuple[Command, ...]:
        """Committed commands that are not undone, the oldest first."""
        in_force = self._history.entries[: self._history.position]
        return tuple(entry.command for entry in in_force)

    @property
    def can_undo(self) -> bool:
        """Whether an edit can be undone."""
        position = self._history.position
        return self._previewed is not None or position > self._history.oldest_position

    @property
    def can_redo(self) -> bool:
        """Whether an edit can be redone."""
        return self._history.position < len(self._history.tree.path)

    @property
    def journal_problem(self) -> str | None:
        """Reason why edits are not stored on disk at the moment; None while they are."""
        return None if self._journal is None else self._journal.problem

    @property
    def journal_path(self) -> Path | None:
        """Path of the journal; None without a journal, or before the first edit."""
        return None if self._journal is None else self._journal.path

    @property
    def variant(self) -> Variant:
        """Name, tags and note of the user; an empty name means a proposed one."""
        return self._variant

    def describe(self, variant: Variant) -> None:
        """Set name, tags and note of the edited scenario; not an undo step."""
        if variant != self._variant:
            self._variant = variant
            if self._journal is not None:
                self._journal.described(variant, self._clock())

    def take_name_back(self) -> None:
        """Forget under which name the state was written, for the user's was taken."""
        now, former = self.committed_scenario, self._numbered
        self._numbered = tuple(one for one in former if one[0] is not now)
        if self._journal is not None and self._numbered != former:
            # The same once more, which is told for no other reason.
            self._journal.described(self._variant, self._clock())

    @property
    def exports(self) -> tuple[tuple[Scenario, ExportMark], ...]:
        """All states that were exported or saved to the library."""
        return self._exports

    @property
    def exports_of_state(self) -> tuple[ExportMark, ...]:
        """Exports of the current state, the oldest first."""
        return tuple(mark for kept, mark in self._exports if kept is self.scenario)

    def mark_exported(self, mark: ExportMark) -> None:
        """Keep in mind that the current state was exported or saved to the library."""
        if mark.name != self.name:
            numbered = (self.scenario, self._variant.name, mark.name)
            self._numbered = (*self._numbered, numbered)
        self._exports = (*self._exports, (self.scenario, mark))
        if self._journal is not None:
            self._journal.exported(mark, self._clock())

    def retry_journal(self) -> None:
        """Write edits to disk that could not be written before, if any."""
        if self._journal is not None:
            self._journal.retry()

    def exchange(self, other: "EditorSession") -> None:
        """Swap everything except the listeners with another session.

        Journals are swapped as well.
        """
        self.commit_gesture()
        other.commit_gesture()
        before = self.state
        parts = ("_base", "_now", "_history", "_journal", "_variant", "_clock")
        parts += (
            "_variants",
            "_dropped",
            "_replayed",
            "_exports",
            "_numbered",
            "lost_edits",
        )
        for name in parts:
            mine, theirs = getattr(self, name), getattr(other, name)
            setattr(self, name, theirs)
            setattr(other, name, mine)
        self._show(self._now, before)

    def apply(self, command: Command) -> None:
        """Commit a command as one undo step; no step if it changes nothing.

        An unfinished gesture is committed first.

        Raises:
            EditError: the command is not valid for the scenario.
        """
        self.commit_gesture()
        before = self.state
        after = self._after(command, self._now)
        self._commit(command, self._now, after, before)

    def begin_gesture(self) -> None:
        """Store the state that previews are applied to; commits an unfinished gesture."""
        self.commit_gesture()
        self._gesture_start = self._now

    def preview(self, command: Command) -> None:
        """Preview a command on the state at the gesture's start.

        Begins a gesture if there is none. A new preview replaces the last one.

        Raises:
            EditError: the command is not valid; the last preview stays.
        """
        start = self._gesture_start or self._now
        after = self._after(command, start)
        before = self.state
        self._gesture_start, self._previewed = start, command
        self._show(after, before)

    def commit_gesture(self) -> None:
        """Commit the last preview as one undo step; no step if it changes nothing."""
        start, command = self._gesture_start, self._previewed
        before = self.state
        self._gesture_start = self._previewed = None
        if start is not None and command is not None:
            self._commit(command, start, self._now, before)

    def abort_gesture(self) -> None:
        """Restore the state at the gesture's start."""
        start, before = self._gesture_start, self.state
        self._gesture_start = self._previewed = None
        if start is not None and before.is_previewing:
            self._show(start, before)

    def undo(self) -> None:
        """Undo the unfinished gesture, or else the last command.

        Raises:
            EditError: there is nothing to undo.
        """
        if self._previewed is not None:
            self.abort_gesture()
            return
        if self._history.position == 0:
            raise EditError("There is nothing to undo.")
        self.jump_to(self._history.position - 1)

    def redo(self) -> None:
        """Redo the command that was undone last.

        Raises:
            EditError: there is nothing to redo.
        """
        self.commit_gesture()
        if not self.can_redo:
            raise EditError("There is nothing to redo.")
        self.jump_to(self._history.position + 1)

    def jump_to(self, position: int) -> None:
        """Undo or redo until ``position`` commands are in force.

        Raises:
            EditError: there is no such position, or it is too long ago.
        """
        self.commit_gesture()
        self.go_to(self._history.number_at(position))

    def go_to(self, number: int) -> None:
        """Restore the state after an edit of any branch; 0 is the opened scenario.

        What follows the edit can be redone then; of several, the newest.

        Raises:
            EditError: there is no such edit, or it is too long ago.
        """
        self.commit_gesture()
        before, tree = self.state, self._history.tree
        snapshot = self._history.go_to(number)
        if snapshot is None:
            return
        self._now = snapshot
        is_other = tree.tip != before.tip
        if is_other:
            self._variants[before.tip] = self._variant
            self._variant = self._variants.get(tree.tip, self._variant)
        if self._journal is not None and is_other:
            self._journal.switched_to(number, self._clock())
        elif self._journal is not None:
            self._journal.moved_to(tree.position, self._clock())
        self._show(snapshot, before)

    def drop_branches(self, numbers: Iterable[int]) -> None:
        """Set which branches are not offered any more, by their last edits.

        They are kept with the others, so that they can be offered again.

        Raises:
            EditError: one of them is no branch, or it is the one in force.
        """
        dropped, tree = frozenset(numbers), self._history.tree
        if dropped == self._dropped:
            return
        if wrong := dropped - set(tree.tips):
            raise EditError(f"There is no branch {min(wrong)}.")
        if tree.tip in dropped - self._dropped:
            raise EditError("The branch in force cannot be dropped; switch first.")
        self._dropped = dropped
        if self._journal is not None:
            self._journal.dropped(dropped, self._clock())

    def select(self, agent_ids: Iterable[str]) -> None:
        """Select exactly these agents; an unfinished gesture is committed first.

        Raises:
            EditError: an id is not in the scenario.
        """
        selection = tuple(dict.fromkeys(agent_ids))
        self._now.scenario.agents.rows(selection)
        self.commit_gesture()
        before = self.state
        if selection != before.selection:
            self._show(Snapshot(scenario=before.scenario, selection=selection), before)

    @property
    def name(self) -> str:
        """Name of the edited scenario: the user's, or else a proposed one.

        Where that was taken, it is what the state was written under. Without edits and
        without a user's name it is the base's id.
        """
        named = self._written_name or self._variant.name or self._proposed_name
        return named or self._base.scenario_id

    @property
    def _written_name(self) -> str:
        """Name under which the state was written, for the user's was taken; else empty."""
        now = self.committed_scenario, self._variant.name
        found = [
            name
            for kept, asked, name in self._numbered
            if kept is now[0] and asked == now[1]
        ]
        return found[-1] if found else ""

    @property
    def _proposed_name(self) -> str:
        commands = self.commands_in_force
        name, replayed = self._replayed
        if _same(commands, replayed):
            return name
        return proposed_name(self._base.scenario_id, commands, self.committed_scenario)

    def show(self) -> Player:
        """A player of the scenario as it is now, for notebooks."""
        return Player(self.scenario)

    def recipe(self) -> Recipe:
        """Recipe of the base and the commands in force, without an unfinished gesture."""
        variant, proposed = self._variant, self._proposed_name
        given = self._written_name or self._replayed[0]
        if name := self._written_name or ("" if variant.name else proposed):
            is_proposed = not variant.name and name == given
            variant = replace(variant, name=name, is_proposed=is_proposed)
        return Recipe(
            base=self._base.reference,
            commands=self.commands_in_force,
            created_at=moment(self._clock(), UTC).isoformat(timespec="seconds"),
            notes=self.committed_scenario.provenance.notes,
            variant=variant,
        )

    def close(self, *, discard: bool = False) -> None:
        """End the session and commit an unfinished gesture.

        ``discard`` also deletes its journal.
        """
        self.commit_gesture()
        if self._journal is not None:
            self._journal.close(discard=discard)
            self._journal = None

    def continue_journal(self, journal: Journal) -> None:
        """Record further edits in ``journal``, which already has the earlier ones."""
        assert self._journal is None
        self._journal = journal

    def add_listener(self, listener: Listener) -> None:
        """Call ``listener(before, after)`` after each change."""
        self._listeners.append(listener)

    def remove_listener(self, listener: Listener) -> None:
        """Stop calling a listener."""
        self._listeners.remove(listener)

    def _after(self, command: Command, start: Snapshot) -> Snapshot:
        """State after a command, with the selection that the command sets."""
        if self._history.position >= MAX_COMMANDS:
            raise EditError(
                f"A recipe has at most {MAX_COMMANDS} edits; export the scenario, and go"
                " on from the export."
            )
        scenario = apply_within_locks(command, start.scenario)
        if scenario is start.scenario:
            return start
        wanted = start.selection if command.selects is None else command.selects
        there = scenario.agents.row_of
        return Snapshot(
            scenario=scenario, selection=tuple(name for name in wanted if name in there)
        )

    def _commit(
        self, command: Command, start: Snapshot, after: Snapshot, before: SessionState
    ) -> None:
        made = self._history.made_before(command)
        if made is not None and after.scenario is not start.scenario:
            # A sample that was used before, for one: its branch is there already.
            self.go_to(made)
            return
        if after.scenario is not start.scenario:
            moment = self._clock()
            entry = HistoryEntry(
                command=command,
                time_s=moment,
                before=start,
                after=after,
                label=command.label_after(start.scenario),
            )
            # Before the entry and the slow journal: a reader in another thread that
            # sees the entry sees its scenario as well.
            self._now = after
            if self.can_redo:
                # The name stays with the branch that has it; a new one is of its edits.
                self._variants[before.tip] = self._variant
                self._variant = replace(self._variant, name="", is_proposed=False)
            self._history.push(entry)
            if self._journal is not None:
                self._journal.committed(command, start.selection, moment)
        self._show(after, before)

    def _show(self, snapshot: Snapshot, before: SessionState) -> None:
        self._now = snapshot
        after = self.state
        for listener in tuple(self._listeners):
            listener(before, after)


def _same(some: Sequence[object], others: Sequence[object]) -> bool:
    """Whether these are the same objects."""
    return len(some) == len(others) and all(map(is_, some, others))
