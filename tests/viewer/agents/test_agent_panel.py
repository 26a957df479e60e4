"""The agent panel: what one, several and no selected agents show."""

import math
from dataclasses import replace

import numpy as np

from pd_editor import open_scenario
from pd_editor.editor.commands import SetAgentKind, SetAgentPosition, SetAgentSpeed
from pd_editor.editor.session import EditorSession
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.scenario import EGO_ID
from pd_editor.viewer.agents.agent_panel import (
    DELETE,
    DUPLICATE,
    EDIT,
    MAKE_FOCAL,
    MIXED,
    SIZE_NOTE,
    summary,
)
from tests.viewer.fake_browser import FakeTab, until


def select(tab: FakeTab, *agent_ids: str) -> None:
    tab.run(lambda: tab.session.select(agent_ids))


def test_fields_that_differ_are_empty_and_apply_to_all(tab: FakeTab):
    """(D32)"""
    ids = tab.session.scenario.agents.ids
    tab.run(lambda: tab.ui.apply(SetAgentKind(agent_ids=ids[1:], kind=AgentKind.BUS)))
    tab.run(lambda: tab.ui.apply(SetAgentSpeed(agent_ids=ids[1:], speed_mps=3.0)))
    select(tab, *ids)
    assert tab.field("Kind").value == MIXED
    assert math.isnan(tab.field("Speed (m/s)").value)
    assert all(map(math.isnan, tab.field("Length, width (m)").value))
    assert "2 agents: 1 vehicle, 1 bus" in tab.text()
    tab.type("Length, width (m)", (5.0, math.nan))
    tab.run(tab.ui.commit_gesture)
    agents = tab.session.scenario.agents
    assert agents.size_m[:, 0].tolist() == [5.0, 5.0]
    assert agents.size_m[0, 1] != agents.size_m[1, 1]
    tab.type("Speed (m/s)", 6.0)
    tab.run(tab.ui.commit_gesture)
    assert tab.field("Speed (m/s)").value == 6.0
    now = tab.session.scenario.current_step
    assert np.allclose(tab.session.scenario.agents.speed_mps()[:, now], 6.0)


def test_activities_are_shown_and_set(tab: FakeTab):
    ids = tab.session.scenario.agents.ids
    tab.run(lambda: tab.ui.apply(SetAgentSpeed(agent_ids=ids[:1], speed_mps=0.0)))
    tab.run(lambda: tab.ui.apply(SetAgentSpeed(agent_ids=ids[1:2], speed_mps=5.0)))
    select(tab, ids[0])
    assert tab.field("Activity").value == "not known"
    tab.type("Activity", "parked")
    assert tab.field("Activity").value == "parked"
    assert tab.session.scenario.activity()[0] == Activity.PARKED
    select(tab, *ids[:2])
    assert tab.field("Activity").value == MIXED
    select(tab, ids[1])
    assert tab.field("Activity").value == "moving"
    before = tab.session.scenario
    tab.type("Activity", "waiting")
    assert "cannot be waiting at" in tab.refusal()
    # Refused in one sentence, and the field shows again what holds.
    assert tab.session.scenario is before
    assert tab.field("Activity").value == "moving"


OF_AGENTS = ("Kind", "Speed (m/s)", "Heading (deg)", "Length, width (m)")


def test_what_is_selected_is_what_is_shown(tab: FakeTab):
    """(Greyed fields of no agent filled the panel.)"""
    ids = tab.session.scenario.agents.ids
    select(tab, ids[0])
    assert tab.field("Kind").value == "vehicle"
    assert tab.field("Length, width (m)").hint == SIZE_NOTE
    assert all(map(tab.offers, (*OF_AGENTS, "Position (m)", "Lock", EDIT)))
    assert not tab.offers("Place on road")
    select(tab, *ids)
    assert all(map(tab.offers, (*OF_AGENTS, "Lock", EDIT)))
    assert not tab.offers("Position (m)")
    select(tab)
    assert "Nothing is selected." in tab.text()
    assert not any(map(tab.offers, (*OF_AGENTS, "Position (m)", "Lock", EDIT)))
    assert tab.offers("Place on road")


def test_placing_is_offered_until_it_ends_whatever_is_selected(tab: FakeTab):
    tab.press("Place on road")
    select(tab, tab.session.scenario.agents.ids[0])
    assert tab.offers("Stop placing")
    tab.press("Stop placing")
    assert not tab.offers("Place on road")


def test_of_an_agent_that_is_not_there_now_no_numbers_are_offered(tab: FakeTab):
    scenario = tab.session.scenario
    gone = scenario.agents.is_valid.copy()
    gone[0, scenario.current_step :] = False
    agents = replace(scenario.agents, is_valid=gone)
    other = EditorSession(replace(scenario, agents=agents))
    tab.run(lambda: tab.session.exchange(other))
    select(tab, scenario.agents.ids[0])
    assert "has left by t = 0" in tab.text().lower()
    assert not any(map(tab.offers, OF_AGENTS))
    assert tab.offers("Lock")
    assert DUPLICATE not in tab.field(EDIT).options
    assert DELETE in tab.field(EDIT).options


def test_a_trajectory_that_no_longer_fits_is_told(tab: FakeTab):
    first, second = tab.session.scenario.agents.ids
    now = tab.session.scenario.current_step
    x, y = tab.session.scenario.agents.position_m[1, now]
    moved = SetAgentPosition(agent_id=second, x_m=float(x) + 8.0, y_m=float(y))
    watch = tab.model.findings
    # Both have a problem later; only the second one's trajectory was carried along.
    both = frozenset((first, second))
    watch.problem_ids = lambda: (both, both)
    tab.run(lambda: tab.ui.apply(moved))
    assert watch.stale_ids() == {second}
    select(tab, second)
    assert "Its trajectory no longer fits" in tab.text()
    select(tab, first)
    assert "no longer fits" not in tab.text()


def test_a_stale_trajectory_is_told_when_the_check_of_the_future_is_done(tab: FakeTab):
    """It was told at the next edit only, as the check comes after the panels are drawn."""
    second = tab.session.scenario.agents.ids[1]
    now = tab.session.scenario.current_step
    x, y = tab.session.scenario.agents.position_m[1, now]
    moved = SetAgentPosition(agent_id=second, x_m=float(x) + 8.0, y_m=float(y))
    watch = tab.model.findings
    select(tab, second)
    found = ()
    checks = []

    def check(*, with_future: bool) -> None:
        nonlocal found
        checks.append(with_future)
        found = (second,) if with_future else ()

    watch.check = check
    watch.problem_ids = lambda: (frozenset(found), frozenset(found))
    tab.run(lambda: tab.ui.apply(moved))
    until(lambda: "Its trajectory no longer fits" in tab.text())
    assert checks == [False, True]


def test_the_ego_is_told():
    """(It was a vehicle as any other.)"""
    demo = open_scenario("merge")
    row = demo.agents.row_of[EGO_ID]
    assert "Ego, there for all 11 s" in summary(demo, np.array([row]))


def test_the_focal_agent_is_not_made_focal_again(tab: FakeTab):
    scenario = tab.session.scenario
    select(tab, scenario.focal_id)
    assert MAKE_FOCAL not in tab.field(EDIT).options
    assert "Focal agent, there for all 11 s" in tab.text()
    other = next(name for name in scenario.agents.ids if name != scenario.focal_id)
    select(tab, other)
    tab.type(EDIT, MAKE_FOCAL)
    assert tab.session.scenario.focal_id == other


def test_a_speed_that_no_agent_has_is_refused_not_replaced(tab: FakeTab):
    """(-4 became 0, and 300 became 60, without a word.)"""
    select(tab, tab.session.scenario.agents.ids[0])
    before = tab.session.scenario
    for typed, limit in ((-4.0, "0 or more"), (300.0, "60")):
        tab.type("Speed (m/s)", typed)
        assert limit in tab.refusal()
    assert tab.session.scenario is before
