"""Branches of a session: edits that were left stay, on disk as well."""

import json
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import TransformAgents
from pd_editor.editor.history import EditTree
from pd_editor.editor.journal import Journal
from pd_editor.editor.session import Branch, EditorSession
from pd_editor.editor.unfinished_work import find_unfinished, restore
from pd_editor.editor.variant import Variant
from tests.editor.command_strategies import busy_scenario
from tests.editor.random_edits import random_command
from tests.editor.same_scenario import same_scenario

BASE = busy_scenario()
NOW = BASE.current_step


def shift(dx: float) -> TransformAgents:
    return TransformAgents(agent_ids=("100",), dx_m=dx)


def place_of(session: EditorSession) -> float:
    return float(session.scenario.agents.position_m[0, NOW, 0])


def tips_of(session: EditorSession) -> list[int]:
    return [branch.number for branch in session.branches]


def two_branches(**options) -> EditorSession:
    """The opened scenario, shifts by 1 and 2 m, and beside the second one by 10 m."""
    session = EditorSession(BASE, **options)
    session.apply(shift(1))
    session.apply(shift(2))
    session.undo()
    session.apply(shift(10))
    return session


def test_what_was_undone_before_another_edit_stays_as_a_branch():
    session = two_branches()
    opened, left, now = session.branches
    assert opened.scenario is BASE
    assert [len(one.entries) for one in session.branches] == [0, 2, 2]
    assert now.scenario is session.scenario
    assert session.state.tip == now.number
    session.go_to(left.number)
    assert place_of(session) == 3
    session.undo()
    session.undo()
    assert session.scenario is BASE
    session.redo()
    session.redo()
    assert place_of(session) == 3
    assert len(session.recipe().commands) == 2


def test_the_opened_scenario_can_be_gone_back_to_and_bent_otherwise():
    session = two_branches()
    session.go_to(0)
    assert session.scenario is BASE
    session.apply(shift(100))
    assert [place(one) for one in session.branches] == [0, 3, 11, 100]


def place(branch: Branch) -> float:
    return float(branch.scenario.agents.position_m[0, NOW, 0])


def test_the_very_command_that_was_undone_begins_no_branch():
    session = EditorSession(BASE)
    sample, other = shift(1), shift(2)
    for command in (sample, other, sample, other):
        session.apply(command)
        session.apply(shift(5))
        session.jump_to(0)
    session.apply(sample)
    tips = tips_of(session)
    assert len(tips) == 5, "the opened scenario, and four times a shift by 5 m"
    assert place_of(session) == 1


def test_names_tags_and_notes_are_of_a_branch():
    session = two_branches()
    session.describe(Variant(name="ten", tags=("far",)))
    session.go_to(2)
    assert session.variant == Variant()
    session.describe(Variant(name="two"))
    session.go_to(3)
    assert session.variant == Variant(name="ten", tags=("far",))
    assert [one.variant.name for one in session.branches] == ["", "two", "ten"]


def test_a_new_branch_is_named_after_its_edit(tmp_path: Path):
    """It had the name that the branch was given which it leaves."""
    session = two_branches(journal=Journal(tmp_path))
    session.describe(Variant(name="ten", tags=("far",), note="seen"))
    session.undo()
    session.apply(shift(3.0))
    assert session.variant == Variant(tags=("far",), note="seen")
    assert "ten" not in session.name
    assert [one.variant.name for one in session.branches] == ["", "", "ten", ""]
    session.close()
    (work,) = find_unfinished(tmp_path)
    again = restore(work, BASE)
    assert [one.variant for one in again.branches] == [
        one.variant for one in session.branches
    ]
    again.close()


def test_a_dropped_branch_is_not_offered_until_it_is_taken_back():
    session = two_branches()
    session.drop_branches({2})
    assert tips_of(session) == [0, 3]
    session.drop_branches(())
    assert tips_of(session) == [0, 2, 3]
    with pytest.raises(EditError, match="in force"):
        session.drop_branches({3})
    with pytest.raises(EditError, match="There is no branch 9"):
        session.drop_branches({9})
    session.drop_branches({2})
    session.go_to(2)
    assert 2 in tips_of(session), "what is in force is always told"


def test_unknown_and_old_edits_are_refused():
    session = two_branches(max_undo=2)
    with pytest.raises(EditError, match="There is no edit 9"):
        session.go_to(9)
    for _ in range(3):
        session.apply(shift(1))
    assert tips_of(session) == [0, 6]
    with pytest.raises(EditError, match="among the last 2"):
        session.go_to(2)
    assert place_of(session) == 14
    with pytest.raises(EditError, match="too long ago"):
        session.jump_to(0)
    session.go_to(0)
    assert session.scenario is BASE, "the opened scenario is kept for good"


@pytest.mark.parametrize("seed", range(3))
def test_random_walks_come_back_with_all_their_branches(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    ticks = count(100)
    session = EditorSession(
        BASE,
        clock=lambda: float(next(ticks)),
        journal=Journal(tmp_path),
        max_undo=30,
    )
    for step in range(80):
        choice, tips = rng.random(), tips_of(session)
        if not session.scenario.agents.ids:
            session.go_to(0)
        elif choice < 0.2 and session.can_undo:
            session.undo()
        elif choice < 0.3 and session.can_redo:
            session.redo()
        elif choice < 0.5:
            session.go_to(int(rng.choice(tips)))
            session.describe(Variant(name=f"branch-{step}"))
        elif choice < 0.55:
            left = set(tips) - {0, session.state.tip}
            session.drop_branches(session.dropped | set(sorted(left)[:1]))
        else:
            ids = session.scenario.agents.ids
            session.select(ids[: rng.integers(3)])
            session.apply(random_command(session.scenario, rng))
    assert len(session.branches) > 3
    session.close()
    (work,) = find_unfinished(tmp_path)
    assert work.num_edits == session.state.position
    again = restore(work, BASE, max_undo=30)
    assert again.lost_edits == ""
    assert again.dropped == session.dropped
    assert again.variant == session.variant
    assert again.state.position == session.state.position
    for one, other in zip(session.branches, again.branches, strict=True):
        assert one.number == other.number
        assert one.variant == other.variant
        assert same_scenario(one.scenario, other.scenario)
    again.close()


def test_a_branch_beside_a_damaged_line_comes_back(tmp_path: Path):
    session = two_branches(journal=Journal(tmp_path))
    session.go_to(2)
    session.close()
    (work,) = find_unfinished(tmp_path)
    lines = work.path.read_bytes().splitlines(keepends=True)
    assert b'"dx_m": 10,' in lines[4]
    lines[4] = b'{"do": "commit"\n'
    work.path.write_bytes(b"".join(lines))
    (work,) = find_unfinished(tmp_path)
    assert work.num_edits == 2
    again = restore(work, BASE)
    assert "1 of the 5 lines" in again.lost_edits
    assert place_of(again) == 3
    again.close()


@pytest.mark.parametrize(
    "line",
    [
        {"do": "go", "time_s": 1, "commit": 9},
        {"do": "go", "time_s": 1, "commit": -1},
        {"do": "drop", "time_s": 1, "commits": [9]},
        {"do": "drop", "time_s": 1, "commits": "all"},
    ],
)
def test_a_line_that_names_no_commit_is_told(tmp_path: Path, line):
    session = two_branches(journal=Journal(tmp_path))
    session.close()
    (work,) = find_unfinished(tmp_path)
    with work.path.open("a") as file:
        file.write(json.dumps(line) + "\n")
    (work,) = find_unfinished(tmp_path)
    again = restore(work, BASE)
    assert "Line 6 of the journal" in again.lost_edits
    assert place_of(again) == 11
    again.close()


def test_the_tree_follows_the_newest_edit_after_one():
    tree = EditTree()
    for _ in range(3):
        tree.add()
    tree.go_to(1)
    tree.add()
    tree.go_to(1)
    assert tree.path == [1, 4]
    assert (tree.position, tree.tips) == (1, [3, 4])
    tree.go_to(2)
    assert tree.path == [1, 2, 3]


@given(st.lists(st.integers(0, 6), max_size=12))
def test_each_branch_leaves_the_earlier_one_that_it_has_most_in_common_with(places):
    tree = EditTree()
    for place in places:
        tree.go_to(min(place, len(tree)))
        tree.add()
    forks = tree.forks(tree.tips)
    assert list(forks) == tree.tips
    for tip, (left, num) in forks.items():
        own, other = tree.edits_to(tip), tree.edits_to(left)
        assert own[:num] == other[:num]
        assert own[num:][:1] != other[num:][:1]
        assert left < tip
        assert (left == 0) == (num == 0)
        earlier = [tree.edits_to(one) for one in tree.tips if one < tip]
        assert all(own[: num + 1] != one[: num + 1] for one in earlier)
