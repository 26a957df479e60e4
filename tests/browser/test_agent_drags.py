"""Agents dragged by a real mouse in both views."""

import re

import numpy as np
import pytest

from tests.browser.view_page import camera_rests

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    page.until(lambda: not page.workspace.playback.is_playing, "a pause")
    return page


def look_from_above(editor) -> None:
    looked_at = editor.client.camera.update_timestamp
    editor.key("v")
    editor.until(
        lambda: (
            editor.client.camera.fov < 0.2
            and editor.client.camera.update_timestamp > looked_at
        ),
        "the browser's word that it looks from above",
    )
    editor.settle()


def positions(editor, agent_ids) -> np.ndarray:
    scenario = editor.session.scenario
    rows = scenario.agents.rows(agent_ids)
    return scenario.agents.position_m[rows, scenario.current_step]


def vehicles_near_focal(editor, count: int) -> tuple[str, ...]:
    """Vehicles of the demo that a pointer can hit, the focal agent first."""
    scenario = editor.session.scenario
    agents, step = scenario.agents, scenario.current_step
    center = agents.position_m[agents.row_of[scenario.focal_id], step]
    rows = np.flatnonzero(
        agents.is_valid[:, step] & (np.array(agents.kinds) == "vehicle")
    )
    away = np.linalg.norm(agents.position_m[rows, step] - center, axis=-1)
    return tuple(agents.ids[row] for row in rows[away.argsort()[:count]])


def roof(editor, agent_id: str) -> np.ndarray:
    return np.append(positions(editor, (agent_id,))[0], 1.4)


def test_one_and_several_agents_dragged_in_the_top_view(editor):
    """(D1) Moved once, one entry, selection kept, whatever the box also says."""
    session = editor.session
    look_from_above(editor)
    first, second, third = vehicles_near_focal(editor, 3)
    before = positions(editor, (first,))
    start = roof(editor, first)
    editor.drag(start, start + np.array([9.0, -4.0, 0.0]))
    editor.until(lambda: len(session.entries) == 1, "one entry")
    assert np.allclose(positions(editor, (first,)) - before, [9.0, -4.0], atol=0.3)
    assert session.selection == (first,)
    editor.key("Control+z")
    editor.until(lambda: session.state.position == 0, "undo")

    together = (first, second, third)
    editor.click_at(roof(editor, second))
    editor.click_at(roof(editor, first), ["Shift"])
    editor.click_at(roof(editor, third), ["Shift"])
    editor.until(lambda: set(session.selection) == set(together), "three selected")
    before = positions(editor, together)
    start = roof(editor, third)
    editor.drag(start, start + np.array([-7.0, 5.0, 0.0]))
    editor.until(lambda: session.state.position == 1, "one entry for three")
    moved = positions(editor, together) - before
    assert np.allclose(moved, [-7.0, 5.0], atol=0.3)
    assert np.ptp(moved, axis=0).max() < 1e-9
    assert set(session.selection) == set(together)
    assert len(session.entries) == 1


def test_shift_drag_turns_and_ctrl_drag_from_an_agent_draws_a_box(editor):
    """(D1) The same press in the top view under the two modifiers."""
    session = editor.session
    look_from_above(editor)
    first, second = vehicles_near_focal(editor, 2)
    start = roof(editor, first)
    heading = session.scenario.agents.heading_rad[
        session.scenario.agents.row_of[first], session.scenario.current_step
    ]
    along = 1.6 * np.array([np.cos(heading), np.sin(heading), 0.0])
    side = 6.0 * np.array([-np.sin(heading), np.cos(heading), 0.0])
    editor.drag(start + along, start + side, "Shift")
    editor.until(lambda: len(session.entries) == 1, "a turn")
    assert session.selection == (first,)
    assert "Turn" in session.entries[0].label
    editor.key("Control+z")
    editor.until(lambda: session.state.position == 0, "undo")

    far = roof(editor, second)
    beyond = far + 4.0 * np.sign(far - start)
    editor.drag(start - 1.5 * np.sign(far - start), beyond, "Control")
    editor.until(lambda: second in session.selection, "a box")
    assert session.state.position == 0


def test_escape_takes_a_drag_back(editor):
    """Until the button is released nothing moves again, and no box selects."""
    session, opened = editor.session, editor.session.scenario
    look_from_above(editor)
    (agent_id,) = vehicles_near_focal(editor, 1)
    start = editor.pixel(roof(editor, agent_id))
    mouse = editor.page.mouse
    mouse.move(*start)
    editor.page.wait_for_timeout(200)
    mouse.down()
    for step in range(1, 12):
        mouse.move(start[0] + 6 * step, start[1])
        editor.page.wait_for_timeout(25)
    editor.until(lambda: session.state.is_previewing, "the drag")
    editor.page.keyboard.press("Escape")
    editor.until(lambda: session.scenario is opened, "the drag taken back")
    for step in range(1, 6):
        mouse.move(start[0] + 66 + 6 * step, start[1] + 20)
        editor.page.wait_for_timeout(25)
    mouse.up()
    editor.page.wait_for_timeout(400)
    assert session.scenario is opened
    assert session.selection == (agent_id,)
    assert not session.entries


def test_a_drag_of_an_agent_draws_no_selection_box_and_one_of_the_road_does(editor):
    """From above, a lilac box was drawn from the press on an agent to the pointer."""
    look_from_above(editor)
    box = "__viserMutable.canvas2d"
    is_seen = f"{box}.width > 0 && getComputedStyle({box}).visibility === 'visible'"
    (agent_id,) = vehicles_near_focal(editor, 1)
    x, y = editor.pixel(roof(editor, agent_id))
    for start, draws in (((x, y), False), ((x - 260, y - 160), True), ((x, y), False)):
        editor.page.mouse.move(*start)
        editor.page.wait_for_timeout(200)
        editor.page.mouse.down()
        for step in range(1, 8):
            editor.page.mouse.move(start[0] + 6 * step, start[1] + 6 * step)
            editor.page.evaluate("new Promise(requestAnimationFrame)")
        assert editor.page.evaluate(is_seen) is draws
        editor.page.mouse.move(*start)
        editor.page.mouse.up()
        editor.settle()


def test_a_drag_right_after_the_view_key_moves_by_what_was_dragged(editor):
    """(D36) Only the camera that the browser showed counts."""
    session = editor.session
    (agent_id,) = vehicles_near_focal(editor, 1)
    before = positions(editor, (agent_id,))
    start = editor.pixel(roof(editor, agent_id))
    mouse = editor.page.mouse
    mouse.move(*start)
    editor.page.wait_for_timeout(200)
    editor.page.keyboard.press("v")
    mouse.down()
    for step in range(1, 13):
        mouse.move(start[0] + 5 * step, start[1])
    mouse.up()
    editor.page.wait_for_timeout(1500)
    assert np.linalg.norm(positions(editor, (agent_id,)) - before) < 25.0
    assert len(session.entries) <= 1


def test_what_a_drag_does_to_the_future_is_told(editor):
    """The chip tells later problems after the mouse is let go, in either view."""
    session, watch = editor.session, editor.tab().ui.model.findings
    look_from_above(editor)
    (agent_id,) = vehicles_near_focal(editor, 1)
    before = session.scenario
    assert not watch.new
    start = roof(editor, agent_id)
    heading = before.agents.heading_rad[before.agents.row_of[agent_id]]
    heading = heading[before.current_step]
    aside = np.array([-np.sin(heading), np.cos(heading), 0.0])
    # Turned across its road, at its speed, it leaves the road later.
    editor.drag(start, start + 6.0 * aside, "Shift")
    editor.until(lambda: len(session.entries) == 1, "one entry")
    assert session.scenario is not before
    status = editor.page.get_by_role("status", name="Status")
    editor.until(lambda: status.inner_text() != "No new problems", "the chip")
    editor.until(lambda: any(not p.is_now for p in watch.new), "a later problem")
    told = editor.page.get_by_text(re.compile(r"^[1-9]\d* new problem"))
    told.first.wait_for()


def test_the_offered_goal_of_a_slow_agent_leaves_its_drag_alone(editor):
    """(W11) Its flag stood on the agent, so that a drag set a goal.

    (W12) A press on an agent writes no error to the browser's console.
    """
    session, agent_id, errors = editor.session, "pedestrian-0038", []
    editor.page.on(
        "console", lambda line: line.type == "error" and errors.append(line.text)
    )
    look_from_above(editor)
    editor.key("Home")
    camera_rests(editor)
    place = positions(editor, (agent_id,))[0]
    editor.click_at(place)
    editor.until(lambda: session.selection == (agent_id,), "a selection")
    editor.drag(place, place + np.array([10.0, 0.0]))
    editor.until(lambda: len(session.entries) == 1, "one entry")
    assert session.entries[0].label.startswith(f"Move agent {agent_id}")
    # Seen from near, the flag stands clear of the agent.
    assert not editor.page.locator(".pd-guide-offer .pd-guide-flag").count()
    editor.key("f")
    editor.page.locator(".pd-guide-offer .pd-guide-flag").wait_for()
    assert not errors
