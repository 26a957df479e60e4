"""Agents placed by a real mouse: mode, banner, cursor, ghost, heading, kinds (D7, D8)."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.scene.agent_kind import AgentKind

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    return page


def focal_ahead(editor, distance_m: float) -> tuple[np.ndarray, float]:
    scenario = editor.session.scenario
    row, step = scenario.agents.row_of[scenario.focal_id], scenario.current_step
    heading = float(scenario.agents.heading_rad[row, step])
    ahead = distance_m * np.array([np.cos(heading), np.sin(heading)])
    return scenario.agents.position_m[row, step] + ahead, heading


def banner(editor):
    return editor.page.get_by_role("status", name="Mode")


def cursor(editor) -> str:
    return editor.page.evaluate("getComputedStyle(__viserMutable.canvas).cursor")


def placed(editor, count: int):
    """Row of the agent that was placed last, once there are so many agents."""
    session = editor.session
    editor.until(lambda: len(session.scenario.agents) == count, f"{count} agents")
    return session.scenario.agents, count - 1


def test_placing_shows_its_mode_and_turns_by_dragging(editor):
    """(D8)"""
    session, page = editor.session, editor.page
    before = len(session.scenario.agents)
    editor.open_tab("Road")
    editor.key("p")
    editor.until(lambda: editor.tab().elements.placing.is_active, "the mode")
    banner(editor).get_by_text("Placing a vehicle").wait_for()
    point, heading = focal_ahead(editor, 12.0)
    page.mouse.move(*editor.pixel(point))
    editor.until(lambda: cursor(editor) == "crosshair", "a crosshair")
    ghost = page.locator(".pd-placing-base")
    editor.until(lambda: "M" in (ghost.get_attribute("d") or ""), "a ghost")
    editor.until(
        lambda: abs(editor.shown("placing")["headingRad"] - heading) < 0.3,
        "the heading of the lane",
    )
    editor.screenshot("09_placing")

    # Keys choose the kind and do not change the view; a drag gives the heading.
    view = np.array(editor.client.camera.position)
    editor.key("2")
    banner(editor).get_by_text("Placing a bus").wait_for()
    start, end = editor.pixel(point), editor.pixel(point + np.array([9.0, 9.0]))
    editor.drag_pixels(start, end)
    agents, row = placed(editor, before + 1)
    assert agents.kinds[row] is AgentKind.BUS
    assert agents.heading_rad[row, 49] == pytest.approx(np.pi / 4, abs=0.05)
    assert np.linalg.norm(agents.position_m[row, 49] - point) < 0.3
    assert np.allclose(editor.client.camera.position, view, atol=0.01)
    assert len(session.entries) == 1

    editor.key("5")
    banner(editor).get_by_text("Placing a pedestrian").wait_for()
    side, _ = focal_ahead(editor, 21.0)
    editor.click_at(side)
    agents, row = placed(editor, before + 2)
    assert agents.kinds[row] is AgentKind.PEDESTRIAN
    editor.key("Escape")
    editor.until(lambda: not editor.tab().elements.placing.is_active, "the end")
    banner(editor).wait_for(state="hidden")
    editor.until(lambda: cursor(editor) != "crosshair", "the usual cursor")
    assert ghost.is_hidden()


def test_placing_in_the_top_view_draws_no_box(editor):
    """(D8)"""
    session, before = editor.session, len(editor.session.scenario.agents)
    editor.look_from_above()
    editor.key("p")
    banner(editor).get_by_text("Placing a vehicle").wait_for()
    point, _ = focal_ahead(editor, 14.0)
    editor.drag(point, point + np.array([-8.0, 0.0]))
    agents, row = placed(editor, before + 1)
    assert abs(abs(agents.heading_rad[row, 49]) - np.pi) < 0.05
    assert session.selection == (agents.ids[row],)
    # What is selected is shown when the tool is laid down.
    editor.key("Escape")
    shown = editor.page.get_by_role("tab", name="Agents", exact=True)
    expect(shown).to_have_attribute("aria-selected", "true")


def test_edits_away_from_t_0_bring_the_playhead_there(editor):
    """(D7) The banner says it; a click places where it points; numbers act at t = 0."""
    session, playback = editor.session, editor.workspace.playback
    before = len(session.scenario.agents)
    editor.seek(3.1)
    told = "You see t = 3.1 s; edits in the picture act at t = 0 s."
    banner(editor).get_by_text(told).wait_for()
    editor.screenshot("10_other_time")
    editor.press("Go to t = 0")
    editor.until(lambda: playback.step == playback.axis.current_step, "t = 0")
    banner(editor).wait_for(state="hidden")

    editor.seek(3.1)
    editor.key("p")
    editor.until(
        lambda: playback.step == playback.axis.current_step, "placing to begin at t = 0"
    )
    editor.seek(3.1)
    point, _ = focal_ahead(editor, 15.0)
    editor.click_at(point)
    agents, row = placed(editor, before + 1)
    assert np.linalg.norm(agents.position_m[row, 49] - point) < 0.3
    assert playback.step == playback.axis.current_step
    poses = editor.until(
        lambda: (p := editor.tab().ui.model.poses) and len(p.position_m) > row and p,
        "the new agent in the picture",
    )
    assert np.linalg.norm(poses.position_m[row] - point) < 0.3
    editor.key("Escape")

    editor.seek(2.0)
    editor.open_tab("Agents")
    editor.fill("Speed (m/s)", 3.0)
    editor.until(lambda: len(session.entries) == 2, "a speed")
    assert playback.step == playback.axis.current_step


def test_a_drag_away_from_t_0_moves_nothing(editor):
    """(D7) The agent under the pointer stands elsewhere at t = 0."""
    session, playback = editor.session, editor.workspace.playback
    opened = session.scenario
    editor.seek(1.0)
    row = opened.agents.row_of[opened.focal_id]
    x, y = editor.tab().ui.model.poses.position_m[row]
    editor.drag((x, y, 1.2), (x + 4.0, y + 3.0, 1.2))
    editor.until(lambda: playback.step == playback.axis.current_step, "t = 0")
    assert session.scenario is opened
    assert not session.entries
    assert session.selection == (opened.focal_id,)
