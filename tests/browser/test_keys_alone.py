"""The five journeys of a user who has a keyboard alone."""

import pytest
from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def command(editor, words: str) -> None:
    """Choose among all commands."""
    page = editor.page
    editor.key("Control+k")
    search = page.get_by_placeholder("Search commands...")
    search.wait_for()
    page.keyboard.type(words)
    wanted = page.locator(".mantine-Spotlight-action", has_text=words).first
    wanted.wait_for()
    while not wanted.get_attribute("data-selected"):
        page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    search.wait_for(state="hidden")


def aim(editor, mode: str, *keys: str) -> None:
    """Move the cross in a tool, once it is on."""
    editor.page.wait_for_function(f"document.body.classList.contains('{mode}')")
    for key in keys:
        editor.page.keyboard.press(key)
    expect(editor.page.locator(".pd-aims")).to_be_visible()


def test_five_journeys(open_editor):
    """Only the mouse could set a goal or a region; commands lacked tabs and exports."""
    editor = open_editor()
    page, session = editor.page, editor.session
    opened, focal = session.scenario, session.scenario.focal_id
    # The speed of a car.
    editor.key("Control+f")
    page.get_by_placeholder("Search by id, kind, focal, ego").wait_for()
    page.keyboard.type(focal)
    expect(page.locator(".pd-agents-row")).to_have_count(1)
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    editor.until(lambda: session.selection == (focal,), "a selection")
    speed = page.get_by_label("Speed (m/s)")
    speed.wait_for()
    page.keyboard.press("F6")
    expect(speed).to_be_focused()
    page.keyboard.press("Control+a")
    page.keyboard.type("5")
    page.keyboard.press("Enter")
    editor.until(lambda: session.state.position == 1, "a speed")
    editor.key("Control+f")

    # A goal, and its run.
    editor.key("v")
    editor.until(lambda: editor.seen_camera.fov < 0.2, "the top view")
    editor.key("f")
    editor.key("t")
    # From the middle of the picture into the junction ahead.
    aim(editor, "pd-guiding", *["Shift+ArrowUp"] * 3, "Shift+ArrowRight")
    page.keyboard.press("Enter")
    editor.until(lambda: session.scenario.guidance, "a goal")
    expect(page.locator(".pd-aims")).to_be_hidden()
    position = session.state.position
    editor.key("r")
    editor.until(lambda: session.state.position > position, "a run", 120)

    # Back to the recording, and another bend: by the tab that is asked for.
    for _ in range(session.state.position):
        editor.key("Control+z")
    editor.until(lambda: session.scenario is opened, "the recording")
    editor.key("Control+y")
    editor.until(lambda: session.state.position == 1, "redone by its second key")
    editor.key("Control+z")
    command(editor, "Open the tab Road")
    page.wait_for_function(
        "document.activeElement.closest('[data-scrollarea-viewport]') !== null"
    )
    assert editor.workspace.view.panel_tab == "Road"

    # Samples of a region.
    command(editor, "Draw a region to resample")
    aim(editor, "pd-drawing-region", "Shift+ArrowUp", "Shift+ArrowLeft")
    page.keyboard.press("Enter")
    for key in ("ArrowDown", "ArrowRight"):
        for _ in range(3):
            page.keyboard.press(f"Shift+{key}")
    page.keyboard.press("Enter")
    region = editor.tab().elements.region
    editor.until(lambda: region.region is not None, "a region")
    page.keyboard.press("F6")
    page.keyboard.press("F6")
    expect(editor.run_bar.locator("button").first).to_be_focused()

    # An export.
    with page.expect_download() as download:
        command(editor, "Download in the chosen format")
    assert download.value.suggested_filename.endswith(".zip")
