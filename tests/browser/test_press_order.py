"""Presses on the picture at once after a tool, while the server is still busy."""

import time

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath

pytestmark = [pytest.mark.browser, pytest.mark.slow]

BUSY_S = 1.0
"""Time that the server is busy with earlier work when a tool is pressed."""
AGENT = "car-0009"


class Hasty:
    """A user who presses tools and the road of a busy server without looking."""

    def __init__(self, editor) -> None:
        self.editor, self.page, self.session = editor, editor.page, editor.session
        scenario = editor.session.scenario
        row, now = scenario.agents.row_of[AGENT], scenario.current_step
        self.place = scenario.agents.position_m[row, now]
        velocity = scenario.agents.velocity_mps[row, now]
        self.along = velocity / np.hypot(*velocity)
        self.near, self.far = (
            editor.pixel(self.place + metres * self.along) for metres in (8.0, 22.0)
        )

    def keep_busy(self) -> None:
        self.editor.tab().ui.post(lambda: time.sleep(BUSY_S))

    def tool(self, toolbar: str, name: str) -> None:
        bar = self.page.get_by_role("toolbar", name=toolbar, exact=True)
        bar.get_by_role("button", name=name, exact=True).click()

    def drag(self) -> None:
        self.page.mouse.move(*self.near)
        self.page.mouse.down()
        self.page.mouse.move(*self.far, steps=8)
        self.page.mouse.up()


@pytest.fixture
def hasty(open_editor):
    editor = open_editor()
    editor.go_to_now()
    editor.look_from_above()
    editor.close_notifications()
    editor.select((AGENT,))
    editor.settle()
    return Hasty(editor)


@pytest.mark.parametrize("way", ["tool", "key", "button"])
def test_a_click_at_once_after_the_placing_tool_places(hasty, way):
    editor, session = hasty.editor, hasty.session
    before = len(session.scenario.agents)
    editor.select(())
    editor.open_tab("Agents")
    button = hasty.page.get_by_role("button", name="Place on road", exact=True)
    button.scroll_into_view_if_needed()
    hasty.keep_busy()
    if way == "tool":
        hasty.tool("Tools", "Place agents (P)")
    elif way == "key":
        hasty.page.keyboard.press("p")
    else:
        button.click()
    hasty.page.mouse.click(*hasty.far)
    editor.until(lambda: len(session.scenario.agents) == before + 1, "an agent")
    placed = session.scenario.agents.position_m[-1, session.scenario.current_step]
    assert np.linalg.norm(placed - hasty.place - 22.0 * hasty.along) < 0.5
    # At once after the end of the mode, a click is the picture's again.
    hasty.keep_busy()
    hasty.tool("Tools", "Place agents (P)")
    hasty.page.mouse.click(*editor.pixel(hasty.place))
    editor.until(lambda: session.selection == (AGENT,), "a selection")
    assert len(session.scenario.agents) == before + 1


def test_a_press_at_once_after_a_guidance_tool_is_the_terms(hasty):
    editor, session, page = hasty.editor, hasty.session, hasty.page
    editor.open_tab("Agents")
    hasty.keep_busy()
    hasty.tool("Add guidance", "Goal")
    page.mouse.click(*hasty.far)
    editor.until(lambda: session.scenario.guidance, "a goal")
    (goal,) = session.scenario.guidance
    assert isinstance(goal, GoalPoint)

    camera = np.array(editor.client.camera.position)
    hasty.keep_busy()
    page.keyboard.press("d")
    hasty.drag()
    editor.until(lambda: len(session.scenario.guidance) == 2, "a path")
    path = session.scenario.guidance[1]
    assert isinstance(path, FollowPath)
    assert np.allclose(editor.client.camera.position, camera, atol=0.01)
    assert session.selection == (AGENT,)


def test_a_drag_at_once_after_its_button_draws_the_region(hasty):
    editor, page = hasty.editor, hasty.page
    editor.open_tab("Generate")
    button = page.get_by_role("button", name="Draw a region", exact=True)
    button.scroll_into_view_if_needed()
    hasty.keep_busy()
    button.click()
    hasty.drag()
    editor.until(lambda: editor.tab().elements.region.region, "a region")


def test_clicks_at_once_after_the_measuring_tool_set_points(hasty):
    hasty.keep_busy()
    hasty.tool("Tools", "Measure distances (M)")
    hasty.page.mouse.click(*hasty.near)
    hasty.page.wait_for_timeout(400)
    hasty.page.mouse.click(*hasty.far)
    total = hasty.page.locator(".pd-measure-total")
    expect(total).to_contain_text("14.")
