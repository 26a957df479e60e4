"""Way-points of a path by mouse: clicked, given a speed, dragged, and obeyed."""

import numpy as np
import pytest

from tests.browser.test_guidance import steered  # noqa: F401

pytestmark = pytest.mark.slow


def test_a_path_gets_a_speed_at_a_way_point_and_is_driven(steered):  # noqa: F811
    editor, page = steered.editor, steered.page
    points = [steered.ahead(one) for one in (12.0, 24.0, 36.0)]
    steered.tool("Path")
    steered.banner("click its points")
    for point in points:
        steered.click(point)
    page.keyboard.press("Enter")
    editor.until(lambda: steered.guidance, "a path")
    assert len(steered.guidance[0].points_m) == 4

    # A click chooses a way-point, whose speed is given in the panel.
    steered.click(steered.guidance[0].points_m[2])
    speed = page.get_by_role("spinbutton", name="Speed of Path")
    speed.fill("4")
    speed.press("Enter")
    editor.until(
        lambda: steered.guidance[0].speeds_mps == (None, None, 4.0, None), "a speed"
    )
    page.locator(".pd-guide-label", has_text="4 m/s").wait_for()

    # It is dragged; between two others is room for one more; a key removes that.
    aside = steered.ahead(24.0, 1.8)
    here = steered.guidance[0].points_m[2]
    editor.drag_pixels(editor.pixel(here), editor.pixel(aside), "Alt")
    editor.until(
        lambda: np.linalg.norm(steered.guidance[0].points_m[2] - aside) < 0.5, "a drag"
    )
    steered.click(np.mean(steered.guidance[0].points_m[1:3], axis=0))
    editor.until(lambda: len(steered.guidance[0].points_m) == 5, "a way-point more")
    page.keyboard.press("Delete")
    editor.until(lambda: len(steered.guidance[0].points_m) == 4, "one less")
    assert steered.guidance[0].speeds_mps == (None, None, 4.0, None)
    assert steered.agent_id in steered.session.scenario.agents.ids

    # The run tells what was asked and achieved there.
    editor.run("Regenerate", steered.agent_id)
    page.get_by_text("4 m/s at way-point 3").first.wait_for(timeout=60_000)


def test_the_time_of_a_goal_is_dragged_on_the_timeline(steered):  # noqa: F811
    editor, page = steered.editor, steered.page
    steered.tool("Goal")
    steered.banner("click where it should drive to")
    steered.click(steered.ahead(30.0))
    editor.until(lambda: steered.guidance, "a goal")
    handle = page.get_by_role("slider", name=f"Goal of {steered.agent_id}")
    box = handle.bounding_box()
    assert box is not None
    start = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    before = steered.num_edits()
    editor.drag_pixels(start, (start[0] - 90.0, start[1]))
    editor.until(lambda: steered.guidance[0].at_s is not None, "a time")
    editor.until(lambda: steered.num_edits() == before + 1, "one edit", 60)
    at_s = steered.guidance[0].at_s
    handle.press("ArrowRight")
    editor.until(lambda: steered.guidance[0].at_s > at_s, "a tenth more")
    assert steered.guidance[0].at_s == pytest.approx(at_s + 0.1)
