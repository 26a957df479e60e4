"""Drags of agents: one owner per gesture, and the browser's own camera."""

import numpy as np
import pytest

from pd_editor.editor.commands import SetAgentSpeed
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from tests.builders import two_agents_that_pass
from tests.viewer.agents.drag_by_hand import DragByHand, camera_above
from tests.viewer.fake_browser import connected_tab, running_app


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    out = tmp_path_factory.mktemp("drags")
    files = scenario_files(two_agents_that_pass())
    write_files(files, out / "scene", forbidden=None)
    with running_app(out / "library", str(out / "scene")) as app:
        yield app


@pytest.fixture
def tab(app):
    with connected_tab(app) as tab:
        tab.run(tab.elements.timeline.go_to_current)
        # Where a plain drag also draws a box.
        tab.run(tab.elements.viewpoint.switch)
        yield tab


def start_of(tab, row=0):
    scenario = tab.session.scenario
    present = np.flatnonzero(scenario.agents.is_valid[:, scenario.current_step])
    row = int(present[row])
    return scenario.agents.ids[row], scenario.agents.position_m[
        row, scenario.current_step
    ]


def by(start, dx_m, dy_m):
    return start + np.array([dx_m, dy_m])


def shift_of(tab, agent_id, start):
    scenario = tab.session.scenario
    row, now = scenario.agents.row_of[agent_id], scenario.current_step
    return scenario.agents.position_m[row, now] - start


@pytest.mark.parametrize("order", ["box first", "end first"])
def test_a_box_of_the_same_press_is_ignored(tab, order):
    """(D1)"""
    agent_id, start = start_of(tab)
    target = by(start, 12.0, 5.0)
    pointer = DragByHand(tab, agent_id)
    pointer.say("start", start)
    pointer.say("update", target)
    last = [
        lambda: pointer.box(start, target),
        lambda: pointer.say("end", target),
    ]
    for event in last if order == "box first" else reversed(last):
        event()
    assert np.allclose(shift_of(tab, agent_id, start), [12.0, 5.0], atol=0.01)
    assert tab.session.selection == (agent_id,)
    assert len(tab.session.entries) == 1


def test_the_next_box_selects_again(tab):
    """(D1)"""
    agent_id, start = start_of(tab)
    pointer = DragByHand(tab, agent_id)
    pointer.say("start", start)
    pointer.say("end", by(start, 12.0, 5.0))
    pointer.box(start, by(start, 12.0, 5.0))
    other, there = start_of(tab, 1)
    pointer.box(by(there, -2.0, -2.0), by(there, 2.0, 2.0))
    assert tab.session.selection == (other,)


def test_a_box_is_ignored_after_the_modifier_changed_on_the_way(tab):
    """(D1)"""
    agent_id, start = start_of(tab)
    moves, turns = DragByHand(tab, agent_id), DragByHand(tab, agent_id, rotates=True)
    moves.say("start", start)
    moves.say("end", by(start, 6.0, 0.0))
    turns.say("start", by(start, 6.0, 0.0))
    turns.say("end", by(start, 6.0, 4.0))
    moves.box(start, by(start, 9.0, 4.0))
    assert tab.session.selection == (agent_id,)


@pytest.mark.parametrize("ends", ["escape", "undo", "command"])
def test_a_drag_that_lost_its_gesture_does_nothing_more(tab, ends):
    """(D1)"""
    agent_id, start = start_of(tab)
    pointer = DragByHand(tab, agent_id)
    pointer.say("start", start)
    pointer.say("update", by(start, 3.0, 0.0))
    if ends == "escape":
        tab.run(tab.elements.escape)
    elif ends == "undo":
        tab.run(tab.elements.history.undo)
    else:
        other, _ = start_of(tab, 1)
        faster = SetAgentSpeed(agent_ids=(other,), speed_mps=3.0)
        tab.run(lambda: tab.ui.apply(faster))
    shown, entries = tab.session.scenario, len(tab.session.entries)
    pointer.say("update", by(start, 9.0, 0.0))
    pointer.say("end", by(start, 9.0, 0.0))
    assert tab.session.scenario is shown
    assert len(tab.session.entries) == entries
    assert tab.session.selection == (agent_id,)


def test_a_point_grabbed_beside_the_pixel_keeps_its_distance(tab):
    """(D1) viser takes the press and the grabbed point half a pixel apart."""
    agent_id, start = start_of(tab)
    pointer = DragByHand(tab, agent_id)
    pointer.pixel_shift = (0.0004, 0.0006)
    pointer.say("start", start)
    pointer.say("end", by(start, 3.0, 0.0))
    assert np.allclose(shift_of(tab, agent_id, start), [3.0, 0.0], atol=0.001)


def test_points_of_another_camera_than_the_browsers_move_nothing(tab):
    """(D36)"""
    agent_id, start = start_of(tab)
    pointer = DragByHand(tab, agent_id)
    pointer.known_camera = camera_above(*by(start, 100.0, 40.0))
    pointer.say("start", start)
    pointer.say("update", by(start, 3.0, 0.0))
    pointer.say("end", by(start, 3.0, 0.0))
    assert not tab.session.entries


def test_a_view_that_changes_under_a_drag_leaves_agents_where_they_were(tab):
    """(D36)"""
    agent_id, start = start_of(tab)
    pointer = DragByHand(tab, agent_id)
    pointer.say("start", start)
    pointer.say("update", by(start, 3.0, 0.0))
    pointer.camera = camera_above(*by(start, -60.0, 0.0))
    pointer.say("update", by(start, -50.0, 0.0))
    pointer.say("end", by(start, -50.0, 0.0))
    assert np.allclose(shift_of(tab, agent_id, start), [3.0, 0.0], atol=0.01)
    assert len(tab.session.entries) == 1
