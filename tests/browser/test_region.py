"""A region drawn on the road by a real mouse, and agents sampled in it alone."""

import re

import numpy as np
import pytest

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    return page


def banner(editor):
    return editor.page.get_by_role("status", name="Mode")


def drawn_region(editor):
    return editor.tab().elements.region.region


def near_focal(editor, dx: float, dy: float) -> np.ndarray:
    scenario = editor.session.scenario
    row, step = scenario.agents.row_of[scenario.focal_id], scenario.current_step
    return scenario.agents.position_m[row, step] + [dx, dy]


@pytest.mark.parametrize("view", ["Top view", "3-D view"])
def test_a_region_is_drawn_cleared_and_filled(editor, view):
    session, page = editor.session, editor.page
    editor.open_tab("Generate")
    if view == "Top view":
        editor.look_from_above()
    editor.press("Draw a region")
    banner(editor).get_by_text("Drawing a region").wait_for()
    cursor = "getComputedStyle(__viserMutable.canvas).cursor"
    editor.until(lambda: page.evaluate(cursor) == "crosshair", "a crosshair")
    # To the left and down: the square grows from the corner of the press.
    start, end = near_focal(editor, 9.0, 19.0), near_focal(editor, -10.0, -1.0)
    camera = np.array(editor.client.camera.position)
    editor.drag(start, end)
    region = editor.until(lambda: drawn_region(editor), "a region")
    assert region.half_side_m == pytest.approx(10.0, abs=0.3)
    assert np.allclose(region.center_m, start - 10.0, atol=0.4)
    assert np.allclose(editor.client.camera.position, camera, atol=0.01)
    assert not session.selection
    banner(editor).wait_for(state="hidden")
    label = page.get_by_role("group", name="Region")
    label.wait_for()
    assert re.match(r"Region (19|20)\.\d", label.text_content() or "")
    assert editor.field("Where").value == "In the region I draw"

    # Esc leaves the mode, and the region as it was; undo has nothing to do with it.
    editor.press("Draw a region")
    banner(editor).get_by_text("Drawing a region").wait_for()
    editor.key("Escape")
    banner(editor).wait_for(state="hidden")
    assert drawn_region(editor) == region

    before = session.scenario
    inside = set(region.held(before, before.agents.ids)) - {before.focal_id, "AV"}
    editor.open_folder("How many")
    editor.fill("Vehicles", 2)
    for other in ("Buses", "Motorcyclists", "Cyclists", "Pedestrians"):
        editor.fill(other, 0)
    editor.run("Resample", "region")
    editor.until(lambda: len(session.entries) == 1, "agents", 120)
    command = session.entries[0].command
    assert command.request.region == region
    after = session.scenario
    assert set(before.agents.ids) - set(after.agents.ids) == inside
    new = tuple(set(after.agents.ids) - set(before.agents.ids))
    rows = after.agents.rows(new)
    away = after.agents.position_m[rows, after.current_step] - region.center_m
    # One that a kept agent would hit is left out, and told.
    assert 1 <= len(new) <= 2
    # Repairs move agents onto their lanes by a little.
    assert np.abs(away).max() < region.half_side_m + 3.0
    editor.screenshot(f"60_region_{view.split()[0]}")
    editor.key("Control+z")
    editor.until(lambda: session.scenario is before, "the scenario before")
    assert drawn_region(editor) == region
    page.get_by_role("button", name="Clear the region").click()
    editor.until(lambda: drawn_region(editor) is None, "no region")
    label.wait_for(state="hidden")
    assert editor.field("Where").value == "On the whole mapped road"


def test_a_region_that_is_too_small_is_refused_and_the_mode_stays(editor):
    editor.open_tab("Generate")
    editor.press("Draw a region")
    banner(editor).get_by_text("Drawing a region").wait_for()
    editor.drag(near_focal(editor, 0.0, 0.0), near_focal(editor, 4.0, 2.0))
    editor.page.get_by_text("drag over at least 10 m").first.wait_for()
    assert drawn_region(editor) is None
    assert editor.tab().elements.region.is_active


def test_a_region_outlives_a_reload(editor):
    editor.open_tab("Generate")
    editor.press("Draw a region")
    banner(editor).get_by_text("Drawing a region").wait_for()
    editor.drag(near_focal(editor, 9.0, 13.0), near_focal(editor, -4.0, -1.0))
    region = editor.until(lambda: drawn_region(editor), "a region")
    editor.reload()
    assert editor.until(lambda: drawn_region(editor), "the region again") == region
    assert editor.field("Where").value == "In the region I draw"
    editor.page.get_by_role("group", name="Region").wait_for()
    editor.page.get_by_role("button", name="Clear the region").click()
    editor.until(lambda: drawn_region(editor) is None, "no region")
    editor.reload()
    editor.open_tab("Generate")
    assert editor.field("Where").value == "On the whole mapped road"
    assert drawn_region(editor) is None


def test_the_name_of_a_region_covers_no_words_of_a_mode(editor):
    """It lay over the middle of what to do next."""
    editor.open_tab("Generate")
    editor.look_from_above()
    editor.press("Draw a region")
    editor.drag(near_focal(editor, 9.0, 19.0), near_focal(editor, -10.0, -1.0))
    editor.until(lambda: drawn_region(editor), "a region")
    editor.key("p")
    bar = banner(editor)
    bar.wait_for()
    place = bar.bounding_box()
    editor.page.get_by_role("group", name="Region").evaluate(
        "(one, at) => { one.style.transform = `translate(${at.x + 20}px, ${at.y + 8}px)`; }",
        place,
    )
    assert bar.evaluate(
        "one => { const r = one.getBoundingClientRect();"
        " return [30, 60, 90].every(x => one.contains("
        "document.elementFromPoint(r.x + x, r.y + r.height / 2))); }"
    )
