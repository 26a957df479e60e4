"""Rows of the agent list, and what its events do."""

import time

import numpy as np

from pd_editor.editor.commands import DuplicateAgents, SetAgentSpeed
from pd_editor.scene.palette import LIGHT
from pd_editor.viewer.agents import agent_list
from pd_editor.viewer.agents.agent_list import listed_agents
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import FakeTab


def rows_of(scenario, base, **marks) -> list:
    wanted = {"problems": (), "stale": (), **marks}
    return listed_agents(scenario, base, LIGHT, **wanted)[1]


def test_rows_tell_speed_distance_and_marks():
    base = two_agents_that_pass()
    first, second = base.agents.ids
    edited = SetAgentSpeed(agent_ids=(second,), speed_mps=4.0).apply(base)
    edited = DuplicateAgents(agent_ids=(second,), new_ids=("copy",), dy_m=40.0).apply(
        edited
    )
    rows = {row[0]: row for row in rows_of(edited, base, problems=("copy",))}
    now = base.current_step
    gap = np.hypot(*np.subtract(*base.agents.position_m[:, now]))
    assert rows[base.focal_id][4] & agent_list.FOCAL
    assert rows[second][2] == 4.0
    assert rows[second][3] == round(float(gap), 1)
    assert rows[second][4] & agent_list.EDITED
    assert rows["copy"][4] == agent_list.NEW | agent_list.PROBLEM
    assert not rows[first][4] & (agent_list.EDITED | agent_list.NEW)
    assert rows["copy"][5]


def test_an_update_of_150_agents_is_fast():
    base = two_agents_that_pass()
    names = base.agents.ids
    copies = tuple(f"copy-{number}" for number in range(148))
    scenario = base
    for start in range(0, 148, 2):
        scenario = DuplicateAgents(
            agent_ids=names, new_ids=copies[start : start + 2], dy_m=5.0 * start
        ).apply(scenario)
    assert len(scenario.agents) == 150
    times = []
    for _ in range(5):
        start = time.thread_time()
        rows_of(scenario, base)
        times.append(time.thread_time() - start)
    assert min(times) < 0.010


def test_nothing_is_sent_while_the_list_is_closed(tab: FakeTab):
    tab.run(lambda: tab.session.select(tab.session.scenario.agents.ids))
    assert tab.shown("agents") is None
    tab.run(lambda: tab.model.toggle_drawer("agents"))
    assert tab.shown("agents")["isOpen"]
    tab.run(lambda: tab.model.toggle_drawer("agents"))
    assert not tab.shown("agents")["isOpen"]


def test_events_select_by_row_and_late_ones_are_dropped(tab: FakeTab):
    ids = tab.session.scenario.agents.ids
    tab.hear("agents", kind="open")
    number = tab.shown("agents")["number"]
    select = {"kind": "select", "number": number}
    tab.hear("agents", **select, rows=[1])
    assert tab.session.selection == (ids[1],)
    tab.hear("agents", **select, rows=[0, 99, -1])
    assert tab.session.selection == (ids[0],)
    tab.hear("agents", kind="select", number=number - 1, rows=[1])
    assert tab.session.selection == (ids[0],)
    tab.hear("agents", kind="point", number=number, row=1)
    assert tab.model.pointed_id == ids[1]
    tab.hear("agents", kind="close")
    assert tab.model.pointed_id is None
