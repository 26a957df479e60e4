"""Looking at the scene: zoom, pan, framing, view buttons, by real mouse and keyboard."""

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.browser.view_page import camera_rests, distance_m, ground, ready, tool

pytestmark = [pytest.mark.browser, pytest.mark.slow]

LOWEST_M = 0.2


@pytest.fixture
def editor(open_editor):
    return ready(open_editor())


def looks_north_from_above(editor) -> bool:
    camera = editor.client.camera
    look = np.subtract(camera.look_at, camera.position)
    tilt = np.hypot(*look[:2]) / abs(look[2])
    return tilt < 1e-4 and np.allclose(camera.up_direction, (0, 1, 0), atol=1e-4)


def test_camera_stays_above_the_ground_and_view_buttons_frame_again(editor):
    """(D11) No drag takes the camera below the ground; both buttons always re-frame."""
    opened = editor.client.camera.position.copy()
    x, y = 80, 330
    for _ in range(3):
        editor.drag_pixels((x, y), (x + 15, y - 260))
        assert editor.client.camera.position[2] > LOWEST_M
    camera_rests(editor)
    camera = editor.client.camera
    height = camera.position[2] / np.linalg.norm(camera.position - camera.look_at)
    assert np.isclose(height, np.cos(np.radians(85)), atol=0.01)
    assert not np.allclose(camera.position, opened, atol=1.0)
    tool(editor, "3-D view").click()
    editor.until(
        lambda: np.allclose(editor.client.camera.position, opened, atol=1e-3),
        "the view of the opened scene",
    )

    tool(editor, "Top view").click()
    editor.until(lambda: looks_north_from_above(editor), "the top view")
    camera_rests(editor)
    framed = editor.client.camera.position.copy()
    editor.page.mouse.move(x, y)
    for _ in range(12):
        editor.page.mouse.wheel(0, -400)
        editor.page.wait_for_timeout(60)
    camera_rests(editor)
    assert editor.client.camera.position[2] < 0.3 * framed[2]
    tool(editor, "Top view").click()
    editor.until(
        lambda: np.allclose(editor.client.camera.position, framed, rtol=1e-4),
        "the top view framed again",
    )


@pytest.mark.parametrize("view", ["3-D view", "Top view"])
def test_wheel_zooms_to_the_pointer_and_pans_keep_the_ground_under_it(editor, view):
    """(design 10) The same place stays under the pointer; what turns about it as well."""
    tool(editor, view).click()
    camera_rests(editor)
    box = editor.page.locator("#root canvas").first.bounding_box()
    x, y = 420.0, 300.0
    before, start = ground(editor, x, y), editor.client.camera.position.copy()
    editor.page.mouse.move(box["x"] + x, box["y"] + y)
    for _ in range(3):
        editor.page.mouse.wheel(0, -120)
        editor.page.wait_for_timeout(80)
    camera_rests(editor)
    assert editor.client.camera.position[2] < 0.65 * start[2]
    assert np.allclose(ground(editor, x, y), before, atol=0.02)
    assert abs(editor.client.camera.look_at[2]) < 1e-3
    for _ in range(3):
        editor.page.mouse.wheel(0, 120)
        editor.page.wait_for_timeout(80)
    camera_rests(editor)
    assert np.allclose(editor.client.camera.position, start, rtol=1e-3, atol=0.05)

    def drag(button: str) -> None:
        here = ground(editor, x, y)
        editor.page.mouse.move(x, y)
        editor.page.mouse.down(button=button)
        for part in np.linspace(0, 1, 8):
            editor.page.mouse.move(x - 170 * part, y + 90 * part)
            editor.page.wait_for_timeout(20)
        editor.page.mouse.up(button=button)
        camera_rests(editor)
        assert np.allclose(ground(editor, x - 170, y + 90), here, atol=0.05)

    camera = editor.client.camera
    look = np.subtract(camera.position, camera.look_at)
    drag("right")
    drag("middle")
    for is_placing in (False, True):
        if is_placing:
            editor.key("p")
            editor.until(lambda: editor.tab().elements.placing.is_active, "placing")
        editor.page.keyboard.down("h")
        drag("left")
        editor.page.keyboard.up("h")
    camera = editor.client.camera
    turned = np.subtract(camera.position, camera.look_at)
    assert np.allclose(turned, look, atol=1e-2)
    assert not editor.session.selection
    assert not editor.session.entries


def test_zoom_has_limits(editor):
    """(D11) Neither the wheel nor a long scroll loses the scene."""
    for direction, low, high in ((-1, 3.9, 4.1), (1, 1490, 1510)):
        editor.page.mouse.move(300, 420)
        for _ in range(22):
            editor.page.mouse.wheel(0, 700 * direction)
            editor.page.wait_for_timeout(15)
        camera_rests(editor)
        assert low < distance_m(editor) < high
        assert editor.client.camera.position[2] > LOWEST_M


def test_the_top_view_cannot_be_tilted_and_keys_do_not_push_the_camera(editor):
    """(D34) Neither drags with keys held nor viser's camera keys change the view."""
    start = editor.client.camera.position.copy()
    editor.page.evaluate("document.activeElement && document.activeElement.blur()")
    for key in ("ArrowUp", "ArrowDown", "w", "a", "s", "q", "e"):
        editor.page.keyboard.press(key, delay=120)
    camera_rests(editor)
    assert np.allclose(editor.client.camera.position, start, atol=1e-6)
    editor.key("v")
    editor.until(lambda: looks_north_from_above(editor), "the top view")
    # The server knows the view before the browser shows it; until then a drag turns.
    camera_rests(editor)
    for modifier in ("Shift", "Alt"):
        editor.drag_pixels((60, 300), (210, 420), modifier)
        camera_rests(editor)
        camera = editor.client.camera
        assert looks_north_from_above(editor), (
            modifier,
            camera.position,
            camera.look_at,
        )


@pytest.mark.parametrize("view", ["3-D view", "Top view"])
def test_f_frames_the_extent_of_the_selection_and_home_the_map(editor, view):
    """(D22) Nine agents are in the picture, from above with their trajectories.

    In 3-D a fast agent stood in a corner, to make room for where it drives.
    """
    tool(editor, view).click()
    camera_rests(editor)
    scenario = editor.session.scenario
    agents, step = scenario.agents, scenario.current_step
    present = np.flatnonzero(agents.is_valid[:, step])
    rows = present[np.linspace(0, len(present) - 1, 9).astype(int)]
    chosen = tuple(agents.ids[row] for row in rows)
    editor.tab().ui.post(lambda: editor.session.select(chosen))
    editor.until(lambda: editor.session.selection == chosen, "the selection")
    editor.key("f")
    camera_rests(editor)
    editor.settle()
    for row in rows:
        track = np.flatnonzero(agents.is_valid[row])[::12]
        for at in track if view == "Top view" else (step,):
            editor.pixel(agents.position_m[row, at])
    # A single agent is seen from nearer, in 3-D in the middle.
    far = distance_m(editor)
    editor.tab().ui.post(lambda: editor.session.select(chosen[:1]))
    tool(editor, "Frame the selection").click()
    camera_rests(editor)
    assert distance_m(editor) < 0.7 * far
    if view == "3-D view":
        x, y = editor.pixel(agents.position_m[rows[0], step])
        canvas = editor.page.locator("#root canvas").first.bounding_box()
        assert abs(x - canvas["width"] / 2) < 0.15 * canvas["width"]
        assert abs(y - canvas["height"] / 2) < 0.25 * canvas["height"]
    editor.key("Home")
    camera_rests(editor)
    editor.settle()
    points = np.concatenate(scenario.road_map.polylines)[:, :2]
    for extreme in (points.argmin(axis=0), points.argmax(axis=0)):
        for row in extreme:
            editor.pixel(points[row])


def test_undo_and_redo_are_named_in_the_toolbar(editor):
    """(design 12) The buttons tell which edit they take back, and do it."""
    expect(tool(editor, "Undo")).to_have_attribute("aria-disabled", "true")
    scenario = editor.session.scenario
    other = next(i for i in scenario.agents.ids if i != scenario.focal_id)
    editor.tab().ui.post(lambda: editor.session.select((other,)))
    editor.until(lambda: editor.session.selection, "the selection")
    editor.key("Delete")
    editor.until(lambda: len(editor.session.entries) == 1, "the edit")
    label = editor.session.entries[0].label
    undo = tool(editor, f"Undo: {label} (Ctrl+Z)")
    undo.wait_for()
    expect(undo).to_have_attribute("aria-disabled", "false")
    undo.click()
    editor.until(lambda: editor.session.state.position == 0, "the edit undone")
    tool(editor, f"Redo: {label} (Ctrl+Shift+Z)").click()
    editor.until(lambda: editor.session.state.position == 1, "the edit done again")
