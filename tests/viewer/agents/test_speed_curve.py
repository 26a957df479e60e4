"""The curve of speed above the timeline, without a browser."""

import numpy as np
import pytest

from pd_editor.editor.commands import DeleteAgents, PullSpeed, SetAgentSpeed, SetLocks
from pd_editor.scene.locks import TRAJECTORY_LOCK
from tests.viewer.fake_browser import FakeTab


def hear(tab: FakeTab, **event) -> None:
    tab.hear("speedCurve", **event)


def speed_at(tab: FakeTab, step: int) -> float:
    scenario = tab.session.scenario
    (row,) = scenario.agents.rows(tab.session.selection)
    return float(scenario.agents.speed_mps()[row, scenario.current_step + step])


@pytest.fixture
def driver(tab: FakeTab) -> FakeTab:
    """A tab in which one moving agent is selected."""
    scenario = tab.session.scenario
    speed = scenario.agents.speed_mps()[:, scenario.current_step]
    fastest = scenario.agents.ids[int(np.argmax(speed))]
    tab.run(lambda: tab.session.select((fastest,)))
    return tab


def test_a_pull_is_one_entry_of_the_history_and_moves_the_playhead(driver: FakeTab):
    before = speed_at(driver, 20)
    for speed in (6.0, 5.0, 4.0):
        hear(driver, kind="pull", step=20, speed=speed)
        assert speed_at(driver, 20) == pytest.approx(speed, abs=1e-5)
    assert not driver.session.entries
    axis = driver.session.scenario.time_axis
    assert driver.tab.workspace.playback.step == axis.current_step + 20
    hear(driver, kind="release")
    (entry,) = driver.session.entries
    name = driver.session.selection[0]
    assert entry.command == PullSpeed(agent_id=name, time_s=2.0, speed_mps=4.0)
    driver.run(driver.session.undo)
    assert speed_at(driver, 20) == before


def test_a_cancelled_pull_leaves_nothing(driver: FakeTab):
    before = driver.session.scenario
    hear(driver, kind="pull", step=10, speed=2.0)
    hear(driver, kind="cancel")
    assert driver.session.scenario is before
    assert not driver.session.entries


def test_at_t_0_the_pull_sets_the_current_speed(driver: FakeTab):
    hear(driver, kind="pull", step=0, speed=2.0)
    hear(driver, kind="release")
    (entry,) = driver.session.entries
    assert isinstance(entry.command, SetAgentSpeed)
    assert speed_at(driver, 0) == pytest.approx(2.0)


def test_a_locked_agent_is_told_once_and_the_rest_of_the_pull_is_ignored(
    driver: FakeTab,
):
    selection = driver.session.selection
    driver.run(
        lambda: driver.ui.apply(SetLocks(agent_ids=selection, lock=TRAJECTORY_LOCK))
    )
    before = driver.session.scenario
    for is_told, speed in ((True, 5.0), (False, 4.0)):
        hear(driver, kind="pull", step=10, speed=speed)
        # Escape takes the offer to unlock away.
        assert driver.run(driver.elements.agent.locks.withdraw) is is_told
    hear(driver, kind="release")
    assert driver.session.scenario is before
    hear(driver, kind="pull", step=10, speed=4.0)
    assert driver.run(driver.elements.agent.locks.withdraw)


def test_an_edit_in_between_ends_the_pull(driver: FakeTab):
    """What arrives of it later begins nothing anew."""
    hear(driver, kind="pull", step=10, speed=2.0)
    other = next(
        name
        for name in driver.session.scenario.agents.ids
        if name not in driver.session.selection
    )
    driver.run(lambda: driver.ui.apply(DeleteAgents(agent_ids=(other,))))
    after = driver.session.scenario
    hear(driver, kind="pull", step=10, speed=9.0)
    hear(driver, kind="release")
    assert driver.session.scenario is after
    assert len(driver.session.entries) == 2
