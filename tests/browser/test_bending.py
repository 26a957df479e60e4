"""The road pulled aside by a real mouse."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from tests.browser.test_journey import roof

pytestmark = pytest.mark.slow


def test_the_road_follows_the_mouse_and_escape_lets_it_go(open_editor):
    editor = open_editor()
    session, mouse = editor.session, editor.page.mouse
    editor.go_to_now()
    editor.look_from_above()
    pose = pose_of_anchor(session.base, "focal")
    start, end = pose.apply(np.array([[25.0, 0.0], [25.0, 5.0]]))
    tool = editor.page.get_by_role("button", name="Bend the road: pull it aside (W)")
    tool.click()
    banner = editor.page.get_by_role("status", name="Mode")
    expect(banner).to_contain_text("press on the road and pull it aside")
    expect(banner).to_contain_text("Arrows and Enter press, too.")
    expect(tool).to_have_attribute("aria-pressed", "true")
    mouse.move(*editor.pixel((*start, 0.0)))
    mouse.down()
    mouse.move(*editor.pixel((*((start + end) / 2), 0.0)), steps=4)
    editor.until(lambda: session.state.is_previewing, "the road while it is pulled")
    mouse.move(*editor.pixel((*end, 0.0)), steps=4)
    mouse.up()
    editor.until(lambda: len(session.entries) == 1, "an edit")
    moved = session.scenario.applied_warp.warp.apply(start[None])[0]
    assert np.linalg.norm(moved - end) < 0.5
    editor.screenshot("33_pulled_road")

    bent = session.scenario
    mouse.move(*editor.pixel((*moved, 0.0)))
    mouse.down()
    mouse.move(*editor.pixel((*start, 0.0)), steps=4)
    editor.until(lambda: session.state.is_previewing, "the road pulled back")
    editor.page.keyboard.press("Escape")
    editor.until(lambda: session.scenario is bent, "the road as before")
    mouse.up()
    editor.key("Escape")
    expect(tool).to_have_attribute("aria-pressed", "false")
    # Presses on the picture select again.
    editor.click_at(roof(editor, session.scenario.focal_id))
    editor.until(
        lambda: session.selection == (session.scenario.focal_id,), "the focal agent"
    )
    assert len(session.entries) == 1
