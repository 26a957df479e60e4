from dataclasses import replace
from pathlib import Path

import numpy as np

import pd_editor
from pd_editor.editor.commands import DeleteAgents, SetAgentSpeed, TransformAgents
from pd_editor.scene.palette import LIGHT
from pd_editor.viewer.scene.original_view import _paths, changed_rows, difference_notes
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import connected_tab, running_app


def moved(scenario, dx_m: float):
    return TransformAgents(
        agent_ids=("100",), dx_m=dx_m, dy_m=0.0, rotation_rad=0.0
    ).apply(scenario)


def test_nothing_differs_from_itself():
    scenario = two_agents_that_pass()
    assert not len(changed_rows(scenario.agents, scenario.agents))
    copy = replace(scenario.agents, ids=scenario.agents.ids)
    assert not len(changed_rows(scenario.agents, copy))


def test_moved_slowed_and_removed_agents_differ():
    scenario = two_agents_that_pass()
    assert changed_rows(scenario.agents, moved(scenario, 3.0).agents).tolist() == [0]
    slowed = SetAgentSpeed(agent_ids=("101",), speed_mps=4.0).apply(scenario)
    assert changed_rows(scenario.agents, slowed.agents).tolist() == [1]
    removed = DeleteAgents(agent_ids=("101",)).apply(scenario)
    assert changed_rows(scenario.agents, removed.agents).tolist() == [1]


def test_the_note_tells_the_difference_now_and_at_the_end():
    scenario = two_agents_that_pass()
    slower = SetAgentSpeed(agent_ids=("100",), speed_mps=6.0).apply(
        moved(scenario, 3.0)
    )
    note = difference_notes(scenario, slower, ("100", "101"))
    now, then = note["100"].splitlines()
    assert now == "now: 3.0 m from the original, 4.0 m/s slower"
    assert then.startswith("at 6.0 s: ")
    assert note["101"].splitlines() == [
        "now: 0.0 m from the original, as fast",
        "at 6.0 s: 0.0 m from the original, as fast",
    ]


def test_an_agent_of_no_original_is_said_to_be_new():
    scenario = two_agents_that_pass()
    removed = DeleteAgents(agent_ids=("101",)).apply(scenario)
    assert difference_notes(removed, scenario, ("101",)) == {
        "101": "not in the original"
    }


def test_dashes_lie_where_the_original_drove():
    scenario = two_agents_that_pass()
    now = moved(scenario, 40.0)
    rows = changed_rows(scenario.agents, now.agents)
    dashes, connectors = _paths(scenario, now, rows, LIGHT)
    path = scenario.agents.position_m[0]
    drawn = dashes.points_m[dashes.faces].reshape(-1, 2)
    assert drawn[:, 0].min() >= path[:, 0].min() - 0.01
    assert drawn[:, 0].max() <= path[:, 0].max() + 0.01
    assert np.ptp(connectors.points_m[:, 0]) > 39


def test_an_export_is_compared_by_its_own_name(tmp_path: Path):
    """An exported warp that nothing had changed since was called the original."""
    made = pd_editor.warp("roundabout", kind="smooth-turn", power=6, out=tmp_path)
    with (
        running_app(tmp_path / "library", made.folder) as app,
        connected_tab(app) as tab,
    ):
        tab.hear("compare", kind="hold")
        assert (
            tab.shown("compare")["text"] == "Export of roundabout: nothing has changed"
        )
