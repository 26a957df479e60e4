"""Scorecard and charts, by real mouse and keyboard."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.editor.commands import AdoptTrajectory, TransformAgents

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    return page


def score(editor, title: str):
    return editor.page.locator(".pd-score-row").filter(has_text=title)


def test_the_scorecard_follows_edits_and_goes_to_the_worst(editor):
    editor.page.get_by_role(
        "button", name="Scorecard: metrics beside recordings"
    ).click()
    drawer = editor.page.get_by_role("region", name="Scorecard")
    drawer.wait_for()
    # No title is cut off.
    assert drawer.locator(".pd-score-name").evaluate_all(
        "all => all.length > 9 && all.every(one => one.scrollWidth <= one.clientWidth"
        " && getComputedStyle(one).textOverflow === 'clip')"
    )
    collisions = score(editor, "Collisions at t = 0")
    before = collisions.inner_text()
    scenario = editor.session.scenario
    now = scenario.current_step
    vehicles = [
        row
        for row in np.flatnonzero(scenario.agents.is_valid[:, now])
        if scenario.agents.kinds[row].value == "vehicle"
    ]
    one, other = vehicles[:2]
    gap = scenario.agents.position_m[other, now] - scenario.agents.position_m[one, now]
    name = scenario.agents.ids[one]
    command = TransformAgents(agent_ids=(name,), dx_m=float(gap[0]), dy_m=float(gap[1]))
    editor.tab().ui.post(lambda: editor.session.apply(command))
    editor.until(lambda: collisions.inner_text() != before, "the row follows the edit")
    expect(collisions).to_be_enabled()
    collisions.press("Enter")
    editor.until(
        lambda: len(editor.session.selection) == 2,
        "the agents that collide are selected",
    )
    # The row lists its findings; the scene and the timeline show them alone.
    tab = editor.tab()
    listed = editor.page.get_by_role("group", name="Findings: Collisions at t = 0")
    listed.wait_for()
    expect(collisions).to_be_focused()
    model = tab.ui.model
    editor.until(
        lambda: {one.kind for one in model.marked_findings} == {"collision"},
        "the collisions alone are drawn",
    )
    assert {agent for one in model.marked_findings for agent in one.agent_ids} >= {
        name,
        scenario.agents.ids[other],
    }
    switch = drawer.get_by_role("checkbox", name="Draw findings in the scene")
    switch.click()
    editor.until(lambda: not model.marked_findings, "nothing is drawn")
    switch.click()
    editor.until(lambda: model.marked_findings, "drawn again")
    editor.until(lambda: drawer.locator(".pd-chart").count() == 3, "three charts")
    head = drawer.locator(".pd-chart-head").first
    x = head.get_attribute("x1")
    value = drawer.locator(".pd-chart-value").first
    editor.until(lambda: value.inner_text().strip(), "the value under the playhead")
    editor.seek(3.0)
    editor.until(
        lambda: head.get_attribute("x1") != x, "the playhead moves in the chart"
    )
    editor.screenshot("scorecard")
    editor.key("Control+z")
    editor.until(lambda: collisions.inner_text() == before, "undone")


def test_it_shares_its_place_with_the_agent_list(editor):
    page = editor.page
    editor.key("i")
    page.get_by_role("region", name="Scorecard").wait_for()
    editor.key("Control+f")
    page.get_by_role("region", name="Agent list").wait_for()
    page.get_by_role("region", name="Scorecard").wait_for(state="hidden")
    editor.until(lambda: not editor.tab().ui.model.marked_findings, "no findings")
    page.get_by_role("button", name="Scorecard: metrics").click()
    page.get_by_role("region", name="Agent list").wait_for(state="hidden")
    page.get_by_role("button", name="Close the scorecard").click()
    page.get_by_role("region", name="Scorecard").wait_for(state="hidden")


def hard_braking(scenario) -> AdoptTrajectory:
    """A fast vehicle brakes by 9 m/s^2 for a second, on its own path."""
    agents, now = scenario.agents, scenario.current_step
    row = max(
        np.flatnonzero(agents.is_valid[:, now:].all(axis=1)),
        key=lambda one: np.linalg.norm(
            agents.position_m[one, -1] - agents.position_m[one, now]
        ),
    )
    path, heading = agents.position_m[row, now:], agents.heading_rad[row, now:]
    step_s = scenario.time_axis.step_s
    along = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=-1))]
    )
    later = np.arange(len(path)) * step_s
    speed = np.gradient(along, step_s) - 9.0 * np.clip(later - 2.3, 0.0, 1.0)
    speed = np.maximum(speed, 0.0)
    moved = np.concatenate([[0.0], np.cumsum(speed[:-1] * step_s)])
    place = np.stack([np.interp(moved, along, path[:, axis]) for axis in (0, 1)], -1)
    turned = np.interp(moved, along, np.unwrap(heading))
    forward = np.stack([np.cos(turned), np.sin(turned)], -1)
    return AdoptTrajectory.of_arrays(
        agent_id=agents.ids[row],
        position_m=place,
        heading_rad=turned,
        velocity_mps=speed[:, None] * forward,
    )


def test_hard_braking_is_shown_and_smoothed_with_one_click(editor):
    page, tab = editor.page, editor.tab()
    scenario = editor.session.scenario
    command = hard_braking(scenario)
    name = command.agent_id
    tab.ui.post(lambda: editor.session.apply(command))
    editor.key("i")
    drawer = page.get_by_role("region", name="Scorecard")
    drawer.wait_for()
    score(editor, "Harsh motion").click()
    listed = page.get_by_role("group", name="Findings: Harsh motion")
    finding = listed.get_by_role("button", name=f"{name} brakes with")
    finding.wait_for()

    def drawn():
        return {one.agent_ids[0]: one for one in tab.ui.model.marked_findings}

    editor.until(lambda: name in drawn(), "the part of the trajectory is drawn")
    worst = drawn()[name].worst_step
    later_s = (worst - scenario.current_step) * scenario.time_axis.step_s
    page.get_by_role("button", name=f"Finding at {later_s:.1f} s").click()
    playback = editor.workspace.playback
    editor.until(lambda: playback.step == worst, "the mark goes to its time")
    editor.until(lambda: editor.session.selection == (name,), "it is selected")
    assert name in tab.ui.model.warned_at(playback.step)
    entries = len(editor.session.entries)
    cure = listed.get_by_role("button", name=f"Smooth the motion of {name}")
    cure.click()
    editor.until(lambda: len(editor.session.entries) == entries + 1, "one edit")
    editor.until(lambda: name not in drawn(), "it is no longer drawn")
    finding.wait_for(state="detached")
    editor.screenshot("smoothed")
    editor.key("Control+z")
    editor.until(lambda: name in drawn(), "drawn again after undo")
