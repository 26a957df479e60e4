"""Times of goals, way-points and locks, dragged on the timeline."""

import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.editor.commands import AddGuidance, SetLocks
from pd_editor.scene.locks import Lock
from tests.viewer.fake_browser import FakeTab
from tests.viewer.guidance.test_guiding import by, focal


@pytest.fixture
def agent_id(tab: FakeTab) -> str:
    """The focal agent, selected, with a goal, a timed path and a locked beginning."""
    agent_id, place = focal(tab)
    points = [by(place, ahead, 0.0) for ahead in (0.0, 12.0, 30.0)]
    path = FollowPath(
        agent_id=agent_id,
        points_m=tuple((float(x), float(y)) for x, y in points),
        times_s=(None, 2.0, 4.0),
    )
    x, y = by(place, 20.0, 0.0)
    goal = GoalPoint(agent_id=agent_id, point_m=(float(x), float(y)))
    for command in (
        AddGuidance(term=goal),
        AddGuidance(term=path),
        SetLocks(agent_ids=(agent_id,), lock=Lock(kept_s=1.0)),
    ):
        tab.run(lambda command=command: tab.ui.apply(command))
    tab.run(lambda: tab.session.select((agent_id,)))
    return agent_id


def handles(tab: FakeTab) -> list[tuple[str, int]]:
    return [(h["kind"], h["step"]) for h in tab.shown("timeHandles")["handles"]]


def pull(tab: FakeTab, index: int, *steps: int, kind: str = "drop") -> None:
    tab.hear("timeHandles", kind="grab", index=index)
    for step in steps:
        tab.hear("timeHandles", kind="drag", index=index, step=step)
    tab.hear("timeHandles", kind=kind, index=index)


def test_times_of_the_selection_are_on_the_timeline(tab: FakeTab, agent_id):
    last = tab.session.scenario.time_axis.num_future_steps
    assert handles(tab) == [
        ("goal-point", last),
        ("follow-path", 20),
        ("follow-path", 40),
        ("lock", 10),
    ]
    tab.run(lambda: tab.session.select(()))
    assert handles(tab) == []


def test_each_time_is_dragged_as_one_edit(tab: FakeTab, agent_id):
    count = len(tab.session.entries)
    pull(tab, 0, 40, 33)
    pull(tab, 1, 25)
    pull(tab, 3, 21)
    assert len(tab.session.entries) == count + 3
    goal, path = tab.session.scenario.guidance
    assert goal.at_s == pytest.approx(3.3)
    assert path.times_s == (None, 2.5, 4.0)
    assert tab.session.scenario.locks[agent_id] == Lock(kept_s=2.1)
    # At its end a goal is one without a time again.
    pull(tab, 0, 10_000)
    assert tab.session.scenario.guidance[0].at_s is None


def test_a_time_that_cannot_be_is_told_and_changes_nothing(tab: FakeTab, agent_id):
    before = tab.session.scenario
    pull(tab, 1, 45)
    assert tab.session.scenario is before
    assert any("must increase" in text for _, text in tab.notices)
    pull(tab, 1, 30, kind="cancel")
    assert tab.session.scenario is before
    assert not tab.session.state.is_previewing


def test_a_click_chooses_the_term(tab: FakeTab, agent_id):
    pull(tab, 2)
    assert tab.ui.model.chosen_term == 1
    assert tab.shown("timeHandles")["handles"][2]["isChosen"]
    pull(tab, 9)
    assert tab.ui.model.chosen_term == 1
