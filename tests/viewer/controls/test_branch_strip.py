"""What the strip of branches shows, and what it does with the page's events."""

import numpy as np

from pd_editor.editor.commands import DeleteAgents, TransformAgents
from pd_editor.editor.variant import Variant
from tests.editor.test_session import generated
from tests.viewer.fake_browser import FakeTab, until


def shift(tab: FakeTab, dx_m: float) -> None:
    first = tab.session.scenario.agents.ids[0]
    move = TransformAgents(agent_ids=(first,), dx_m=dx_m)
    tab.run(lambda: tab.ui.apply(move))


def two_branches(tab: FakeTab) -> None:
    """The opened scenario, and two edits of it, the second of which is in force."""
    shift(tab, 0.5)
    tab.run(tab.session.undo)
    _, second = tab.session.scenario.agents.ids
    tab.run(lambda: tab.ui.apply(DeleteAgents(agent_ids=(second,))))


def opened(tab: FakeTab) -> list[dict]:
    tab.press(f"Branches: {len(tab.session.branches)}")
    until(lambda: len(pictures(tab)) == len(tab.session.branches))
    return cards(tab)


def cards(tab: FakeTab) -> list[dict]:
    return tab.shown("branches")["cards"]


def pictures(tab: FakeTab) -> dict[str, str]:
    tab.run(lambda: None)
    try:
        return tab.shown("branch-pictures")["pictures"]
    except KeyError:
        return {}


def test_each_branch_has_a_card_with_a_picture_and_its_problems(tab: FakeTab):
    two_branches(tab)
    assert not tab.shown("branches")["isOpen"]
    shown = opened(tab)
    assert [one["index"] for one in shown] == [0, 1, 2]
    assert [one["mark"] for one in shown] == ["", "", "in use"]
    assert [one["canDrop"] for one in shown] == [False, True, False]
    assert shown[0]["name"] == "Scenario opened"
    assert shown[2]["hint"].startswith("Delete")
    for one in shown:
        assert "problem" in one["lines"][0]["text"]
        assert pictures(tab)[str(one["index"])].startswith("data:image/svg+xml")


def test_a_branch_that_is_in_the_library_has_its_star(tab: FakeTab):
    """Nothing told which of several was saved."""
    two_branches(tab)
    assert not any(one["isKept"] for one in opened(tab))
    tab.press("Save to library")
    assert [one["isKept"] for one in cards(tab)] == [False, False, True]
    tab.choose("library", tab.session.name, "reject")
    assert not any(one["isKept"] for one in cards(tab))


def test_pointing_previews_a_click_switches_and_undo_stays_within(tab: FakeTab):
    two_branches(tab)
    opened(tab)
    here = tab.session.scenario
    tab.hear("branches", kind="point", value=1)
    previewed = tab.ui.model.sample
    assert previewed is not None
    assert tab.session.scenario is here
    tab.hear("branches", kind="leave")
    assert tab.ui.model.sample is None
    tab.hear("branches", kind="adopt", value=1)
    assert tab.session.scenario is previewed
    assert [one["mark"] for one in cards(tab)] == ["", "in use", ""]
    tab.run(tab.session.undo)
    assert [one["mark"] for one in cards(tab)] == ["in use", "", ""]
    assert tab.session.scenario is tab.session.base
    tab.run(tab.session.redo)
    assert tab.session.scenario is previewed


def test_two_branches_are_compared_on_their_own_ground(tab: FakeTab):
    two_branches(tab)
    opened(tab)
    tab.hear("branches", kind="pair", value=1)
    pair = tab.shown("pair")
    assert pair["isOpen"]
    assert [one["index"] for one in pair["sides"]] == [2, 1]
    assert [len(one["agents"]) for one in pair["sides"]] == [1, 2]
    assert all(one["ground"] for one in pair["sides"])
    tab.hear("pair", kind="use", value=1)
    assert not tab.shown("pair")["isOpen"]
    assert tab.session.present == 1
    tab.run(tab.tab.elements.compare)
    assert [one["index"] for one in tab.shown("pair")["sides"]] == [1, 2]
    tab.run(tab.tab.elements.escape)
    assert not tab.shown("pair")["isOpen"]
    assert tab.shown("branches")["isOpen"]
    tab.run(tab.tab.elements.escape)
    assert not tab.shown("branches")["isOpen"]


def test_a_deleted_branch_can_be_put_back(tab: FakeTab):
    two_branches(tab)
    opened(tab)
    tab.hear("branches", kind="drop", value=1)
    assert [one["index"] for one in cards(tab)] == [0, 2]
    assert tab.shown("branches")["numDropped"] == 1
    for value in (0, 2, 9, "x"):
        tab.hear("branches", kind="drop", value=value)
    assert [one["index"] for one in cards(tab)] == [0, 2]
    tab.hear("branches", kind="restore")
    assert [one["index"] for one in cards(tab)] == [0, 1, 2]


def test_a_branch_is_called_what_the_user_calls_it(tab: FakeTab):
    two_branches(tab)
    tab.run(lambda: tab.session.describe(Variant(name="without-it")))
    assert [one["name"] for one in opened(tab)][-1] == "without-it"
    # Another one is used as it is named; the recording has no other name.
    tab.hear("branches", kind="rename", value=1, text="first try")
    assert tab.session.state.tip == 1
    assert [one["name"] for one in cards(tab)][1:] == ["first-try", "without-it"]
    tab.hear("branches", kind="rename", value=0, text="other")
    assert cards(tab)[0]["name"] == "Scenario opened"
    assert tab.session.state.tip == 1


def test_branches_that_end_with_a_run_are_told_apart_by_what_was_edited(tab: FakeTab):
    """All of them were called after the run."""
    first = tab.session.scenario.agents.ids[0]
    for dx_m in (0.5, 1.0):
        tab.run(lambda: tab.session.jump_to(0))
        shift(tab, dx_m)
        tab.run(lambda: tab.ui.apply(generated(tab.session.scenario, first)))
    tab.run(tab.session.undo)
    tab.run(lambda: tab.ui.apply(generated(tab.session.scenario, first)))
    names = [one["name"].split(" by ")[0] for one in opened(tab)][1:]
    moved = tab.session.entries[0].label.split(" by ")[0]
    run = tab.session.entries[1].label.split(" (")[0]
    assert names == [moved, moved, run]


def test_states_of_a_switch_are_those_that_were_left(tab: FakeTab):
    two_branches(tab)
    left = tab.session.scenario.agents.position_m.copy()
    opened(tab)
    for number in (1, 0, 2):
        tab.hear("branches", kind="adopt", value=number)
    assert np.array_equal(tab.session.scenario.agents.position_m, left, equal_nan=True)
