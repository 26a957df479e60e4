"""The session against a plain list of states, and gestures."""

from dataclasses import replace
from itertools import count
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from pd_editor.analysis.guidance.kinds.speed import SpeedLimit
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    Command,
    DeleteAgents,
    DuplicateAgents,
    RemoveGuidance,
    ReplaceTraffic,
    RequestSummary,
    TransformAgents,
)
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.edit_findings import unrun_terms
from pd_editor.editor.journal import Journal
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.session import EditorSession, SessionState
from pd_editor.editor.variant import Variant
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import (
    ON_TRAFFIC,
    STRATEGIES,
    any_command,
    busy_scenario,
    ignore_random_checks,
    present_ids,
    trajectory_from,
)
from tests.editor.random_edits import random_command
from tests.editor.same_scenario import same_scenario

pytestmark = ignore_random_checks
BASE = busy_scenario()


def shift(dx: float, *ids: str) -> TransformAgents:
    return TransformAgents(agent_ids=ids or ("100",), dx_m=dx)


def generated(scenario: Scenario, agent_id: str) -> ReplaceTraffic:
    row = scenario.agents.row_of[agent_id]
    motion = trajectory_from(scenario, agent_id, 5.0, 0.0)
    sample = TrafficSample(
        ids=(agent_id,),
        kinds=(scenario.agents.kinds[row],),
        size_m=scenario.agents.size_m[[row]],
        **{name: values[None] for name, values in motion.items()},
    )
    request = RequestSummary(agent_ids=(agent_id,))
    return ReplaceTraffic(sample=sample, generator="test", request=request)


def session_with(*commands: Command) -> EditorSession:
    ticks = count(1000)
    session = EditorSession(BASE, clock=lambda: float(next(ticks)))
    for command in commands:
        session.apply(command)
    return session


@pytest.mark.parametrize("seed", range(3))
def test_random_walks_end_where_the_recipe_says(seed: int):
    rng = np.random.default_rng(seed)
    session = EditorSession(BASE, max_undo=50)
    for _ in range(200):
        choice = rng.random()
        if choice < 0.2 and session.can_undo:
            session.undo()
        elif choice < 0.3 and session.can_redo:
            session.redo()
        elif choice < 0.33 and session.can_undo:
            lowest = max(session.state.position - 5, session.state.num_entries - 50, 0)
            session.jump_to(int(rng.integers(lowest, session.state.num_entries + 1)))
        else:
            session.apply(random_command(session.scenario, rng))
    recipe = session.recipe()
    assert len(recipe.commands) == session.state.position
    assert same_scenario(replay(recipe, BASE), session.scenario)
    again = Recipe.from_text(recipe.to_text())
    assert again == recipe
    assert same_scenario(replay(again, BASE), session.scenario)


class SessionAgainstList(RuleBasedStateMachine):
    """A list of (scenario, selection) pairs with a cursor is all there is to it."""

    def __init__(self):
        super().__init__()
        self.max_undo = 4
        self.session = EditorSession(BASE, clock=lambda: 0.0, max_undo=self.max_undo)
        self.seen: list[tuple[SessionState, SessionState]] = []
        self.session.add_listener(lambda *states: self.seen.append(states))
        self.states = [BASE]
        self.befores: list[tuple[str, ...]] = []
        self.afters: list[tuple[str, ...]] = []
        self.cursor = 0
        self.oldest = 0
        self.selection: tuple[str, ...] = ()

    def commit(self, command: Command) -> None:
        here = self.states[self.cursor]
        try:
            result = apply_within_locks(command, here)
        except EditError:
            with pytest.raises(EditError):
                self.session.apply(command)
            return
        self.session.apply(command)
        if result is not here:
            del self.states[self.cursor + 1 :]
            del self.befores[self.cursor :], self.afters[self.cursor :]
            self.befores.append(self.selection)
            if command.selects is not None:
                self.selection = command.selects
            there = self.session.scenario.agents.row_of
            self.selection = tuple(one for one in self.selection if one in there)
            self.afters.append(self.selection)
            assert same_scenario(self.session.scenario, result)
            self.states.append(self.session.scenario)
            self.cursor += 1
            self.oldest = max(self.oldest, len(self.states) - 1 - self.max_undo)

    @rule(data=st.data())
    def apply(self, data):
        kind = data.draw(st.sampled_from(ON_TRAFFIC))
        self.commit(data.draw(STRATEGIES[kind](self.states[self.cursor])))

    @rule(dx=st.sampled_from([0.0, 1.5, -2.0]), data=st.data())
    def drag(self, dx, data):
        scenario = self.states[self.cursor]
        names = [one for one in present_ids(scenario) if one not in scenario.locks]
        if not names:
            return
        name = data.draw(st.sampled_from(names))
        self.session.begin_gesture()
        for part in (0.3, 0.9):
            self.session.preview(shift(dx * part, name))
        if data.draw(st.booleans()):
            self.session.abort_gesture()
            return
        before = len(self.session.entries)
        start = self.session.state.position
        self.session.preview(shift(dx, name))
        self.session.commit_gesture()
        assert self.session.state.position == start + (dx != 0)
        assert before >= start
        if dx:
            position = self.session.state.position
            assert self.session.entries[position - 1].command == shift(dx, name)
            del self.states[self.cursor + 1 :]
            del self.befores[self.cursor :], self.afters[self.cursor :]
            self.befores.append(self.selection)
            self.afters.append(self.selection)
            self.states.append(self.session.scenario)
            self.cursor += 1
            self.oldest = max(self.oldest, len(self.states) - 1 - self.max_undo)

    @rule(data=st.data())
    def select(self, data):
        ids = list(self.states[self.cursor].agents.ids)
        self.selection = tuple(data.draw(st.lists(st.sampled_from(ids), unique=True)))
        self.session.select(self.selection)

    @rule()
    def undo(self):
        if self.cursor <= self.oldest:
            with pytest.raises(EditError):
                self.session.undo()
            return
        self.session.undo()
        self.cursor -= 1
        self.selection = self.befores[self.cursor]

    @precondition(lambda self: self.cursor < len(self.states) - 1)
    @rule()
    def redo(self):
        self.session.redo()
        self.selection = self.afters[self.cursor]
        self.cursor += 1

    @rule(data=st.data())
    def jump(self, data):
        target = data.draw(st.integers(0, len(self.states) - 1))
        if target < self.oldest:
            with pytest.raises(EditError, match="too long ago"):
                self.session.jump_to(target)
            return
        self.session.jump_to(target)
        if target < self.cursor:
            self.selection = self.befores[target]
        elif target > self.cursor:
            self.selection = self.afters[target - 1]
        self.cursor = target

    @invariant()
    def same(self):
        state = self.session.state
        assert state.scenario is self.states[self.cursor]
        assert state.selection == self.selection
        assert (state.position, state.num_entries) == (
            self.cursor,
            len(self.states) - 1,
        )
        assert not state.is_previewing
        assert self.session.can_undo == (self.cursor > self.oldest)
        assert self.session.can_redo == (self.cursor < len(self.states) - 1)
        assert len(self.session.recipe().commands) == self.cursor

    @invariant()
    def listeners_saw_every_change(self):
        for before, after in zip(self.seen, self.seen[1:], strict=False):
            assert before[1].scenario is after[0].scenario
        if self.seen:
            assert self.seen[-1][1].scenario is self.session.scenario
            assert self.seen[-1][1].selection == self.session.selection


TestSessionAgainstList = SessionAgainstList.TestCase
TestSessionAgainstList.pytestmark = [ignore_random_checks]
TestSessionAgainstList.settings = settings(
    max_examples=20, stateful_step_count=25, deadline=None
)


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_a_failing_command_changes_nothing(data):
    session = session_with(shift(1.0))
    session.select(("101",))
    command = data.draw(any_command(BASE))
    before, heard = session.state, []
    session.add_listener(lambda *states: heard.append(states))
    bad = DeleteAgents(agent_ids=("100", "missing"))
    for broken in (bad, command):
        try:
            broken.apply(before.scenario)
        except EditError:
            with pytest.raises(EditError):
                session.apply(broken)
            with pytest.raises(EditError):
                session.preview(broken)
            session.abort_gesture()
            assert session.scenario is before.scenario
            assert session.selection == before.selection
            assert session.state.position == before.position
            assert not session.state.is_previewing
            assert heard == []


def test_a_gesture_is_one_step_from_its_start():
    session = session_with()
    session.select(("100", "101"))
    session.begin_gesture()
    for dx in np.linspace(0, 5, 40):
        session.preview(shift(float(dx), "100", "101"))
        assert session.state.is_previewing
        assert session.state.position == 0
    assert session.recipe().commands == ()
    session.commit_gesture()
    assert [entry.label for entry in session.entries] == [
        "Move 2 agents by 5.0 m (100, 101)"
    ]
    moved = session.scenario.agents.position_m[0] - BASE.agents.position_m[0]
    assert np.allclose(moved, [5, 0])
    session.undo()
    assert session.scenario is BASE
    assert session.selection == ("100", "101")


def test_a_gesture_that_comes_back_is_no_step():
    session = session_with()
    session.begin_gesture()
    session.preview(shift(3.0))
    session.preview(shift(0.0))
    session.commit_gesture()
    assert session.entries == ()
    assert session.scenario is BASE


def test_abort_and_undo_take_a_gesture_back():
    for end in (EditorSession.abort_gesture, EditorSession.undo):
        session = session_with(shift(1.0))
        before = session.scenario
        session.begin_gesture()
        session.preview(shift(3.0))
        end(session)
        assert session.scenario is before
        assert session.state.position == 1
        session.commit_gesture()
        assert session.state.position == 1


def test_a_failing_preview_leaves_the_last_one():
    session = session_with()
    session.begin_gesture()
    session.preview(shift(3.0))
    shown = session.scenario
    with pytest.raises(EditError):
        session.preview(shift(6.0, "missing"))
    assert session.scenario is shown
    session.commit_gesture()
    assert session.scenario is shown


@pytest.mark.parametrize(
    "interrupt",
    [
        lambda session: session.apply(shift(1.0, "101")),
        lambda session: session.select(("102",)),
        lambda session: session.begin_gesture(),
    ],
)
def test_other_acts_commit_an_open_gesture(interrupt):
    session = session_with()
    session.begin_gesture()
    session.preview(shift(3.0))
    shown = session.scenario
    interrupt(session)
    assert session.entries[0].command == shift(3.0)
    session.jump_to(1)
    assert session.scenario is shown


def test_what_is_placed_or_copied_is_selected_and_the_deleted_is_not():
    session = session_with()
    session.select(("101", "102"))
    session.apply(DuplicateAgents(agent_ids=("101",), new_ids=("copy",), dx_m=2.0))
    assert session.selection == ("copy",)
    session.apply(DeleteAgents(agent_ids=("copy",)))
    assert session.selection == ()
    session.undo()
    assert session.selection == ("copy",)
    session.undo()
    assert session.selection == ("101", "102")


def test_unknown_agents_cannot_be_selected():
    session = session_with()
    session.select(("100",))
    with pytest.raises(EditError, match="no agent 'ghost'"):
        session.select(("101", "ghost"))
    assert session.selection == ("100",)


def test_an_exchange_swaps_everything_but_the_listeners():
    """(D3): what was open is kept, and what comes back is as it was left."""
    session = session_with(shift(1.0))
    session.describe(Variant(name="first", tags=("a",)))
    session.begin_gesture()
    session.preview(shift(2.0))
    other = EditorSession(busy_scenario())
    heard = []
    session.add_listener(lambda before, after: heard.append((before, after)))
    session.exchange(other)
    assert session.scenario is session.base
    assert session.entries == ()
    assert session.variant == Variant()
    # The gesture is committed first, so that its journal keeps it.
    committed, states = heard
    assert committed[1].num_entries == committed[0].num_entries + 1
    assert states[1].base is not states[0].base
    assert not states[1].is_previewing
    assert len(other.entries) == 2
    session.exchange(other)
    assert len(session.entries) == 2
    assert session.variant.name == "first"
    session.undo()
    assert session.selection == committed[0].selection


def test_nothing_to_undo_or_redo_is_said():
    session = session_with()
    with pytest.raises(EditError, match="nothing to undo"):
        session.undo()
    with pytest.raises(EditError, match="nothing to redo"):
        session.redo()
    with pytest.raises(EditError, match="no step 3"):
        session.jump_to(3)


def test_listeners_can_leave():
    session, heard = session_with(), []
    listener = lambda _, after: heard.append(after)  # noqa: E731
    session.add_listener(listener)
    session.apply(shift(1.0))
    session.remove_listener(listener)
    session.apply(shift(1.0))
    assert [state.position for state in heard] == [1]


def test_entries_know_when_they_were_made():
    session = session_with(shift(1.0), shift(2.0))
    assert [entry.time_s for entry in session.entries] == [1000.0, 1001.0]
    assert session.recipe().created_at.startswith("1970-01-01T00:16:4")


def test_old_states_are_let_go_but_not_their_commands():
    session = EditorSession(BASE, max_undo=3)
    for _ in range(5):
        session.apply(shift(1.0))
    assert [entry.before is None for entry in session.entries] == [True] * 2 + [
        False
    ] * 3
    for _ in range(3):
        session.undo()
    assert not session.can_undo
    with pytest.raises(EditError, match="only the last 3"):
        session.undo()
    session.apply(shift(9.0))
    assert len(session.recipe().commands) == 3
    assert same_scenario(replay(session.recipe(), BASE), session.scenario)


def test_an_entry_that_is_seen_while_it_is_written_shows_its_scenario():
    class Recorder(Mock):
        """Reads the session as another thread does while the journal is written."""

        def committed(self, *_: object) -> None:
            seen.append((session.state.position, session.scenario))

        moved_to = committed

    seen: list[tuple[int, Scenario]] = []
    session = EditorSession(BASE, journal=Recorder(spec=Journal))
    session.apply(shift(1.0))
    moved = session.scenario
    session.undo()
    assert [position for position, _ in seen] == [1, 0]
    assert seen[0][1] is moved
    assert seen[1][1] is BASE


def awaits_run(session: EditorSession) -> bool:
    return bool(unrun_terms(session.scenario, session.commands_in_force))


def test_guidance_awaits_a_run_until_traffic_is_generated():
    session = session_with(shift(1.0))
    assert not awaits_run(session)
    session.apply(AddGuidance(term=SpeedLimit(agent_ids=("100",), speed_mps=5.0)))
    session.apply(shift(0.5))
    assert awaits_run(session)
    session.apply(generated(session.scenario, "101"))
    assert awaits_run(session), "another agent's trajectory"
    session.apply(generated(session.scenario, "100"))
    assert not awaits_run(session)
    session.undo()
    assert awaits_run(session)
    session.redo()
    term = session.scenario.guidance[0]
    session.apply(ChangeGuidance(index=0, term=replace(term, speed_mps=4.0)))
    assert awaits_run(session)
    session.apply(RemoveGuidance(index=0))
    assert not awaits_run(session)
