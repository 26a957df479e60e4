"""Scorecard and charts, by real mouse and keyboard."""

import numpy as np
import pytest

from pd_editor.editor.commands import TransformAgents

pytestmark = pytest.mark.browser


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
    editor._tab()._ui.post(lambda: editor.session.apply(command))
    editor.until(lambda: collisions.inner_text() != before, "the row follows the edit")
    assert collisions.is_enabled()
    collisions.click()
    editor.until(
        lambda: editor.session.selection in ((name,), (scenario.agents.ids[other],)),
        "the agent that collides is selected",
    )
    # The row lists its findings; the scene and the timeline show them alone.
    tab = editor._tab()
    listed = editor.page.get_by_role("group", name="Findings: Collisions at t = 0")
    listed.wait_for()
    drawn = tab.picture.findings
    editor.until(
        lambda: {one.metric for one in drawn._findings} == {"init_overlap"},
        "the collisions alone are drawn",
    )
    assert {one.agent_id for one in drawn._findings} >= {
        name,
        scenario.agents.ids[other],
    }
    switch = drawer.get_by_role("checkbox", name="Draw findings in the scene")
    switch.click()
    editor.until(lambda: not drawn._findings, "nothing is drawn")
    switch.click()
    editor.until(lambda: drawn._findings, "drawn again")
    editor.until(lambda: drawer.locator(".pd-chart").count() == 3, "three charts")
    head = drawer.locator(".pd-chart-head").first
    x = head.get_attribute("x1")
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
    editor.until(lambda: not editor._tab().picture.findings._findings, "no findings")
    page.get_by_role("button", name="Scorecard: metrics").click()
    page.get_by_role("region", name="Agent list").wait_for(state="hidden")
    page.get_by_role("button", name="Close the scorecard").click()
    page.get_by_role("region", name="Scorecard").wait_for(state="hidden")
