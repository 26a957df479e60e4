"""The page of all scenarios, by real mouse and keyboard."""

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser


def focused(page: Page) -> str:
    return page.evaluate("document.activeElement.querySelector('strong')?.textContent")


def test_a_first_day_begins_with_pictures_and_keys(open_editor):
    editor = open_editor(reference=None)
    page, workspace = editor.page, editor.workspace
    whole = page.get_by_role("region", name="All scenarios")
    tiles = whole.get_by_role("listitem")
    expect(tiles).to_have_count(8)
    expect(page.locator(".pd-start-drawn")).to_have_count(8)
    # What it covers is out of reach of Tab.
    expect(page.get_by_role("toolbar", name="Tools")).to_be_hidden()
    editor.screenshot("start_page")

    page.wait_for_function("document.activeElement.matches('.pd-start-tile')")
    assert focused(page) == "bus-stop"
    page.keyboard.press("ArrowRight")
    assert focused(page) == "crosswalk"
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    assert focused(page) == "signalised-junction"
    page.keyboard.press("s")
    editor.until(lambda: workspace.library.cards(), "a kept scenario")
    expect(page.get_by_role("tab", name="Library 1")).to_be_visible()
    assert focused(page) == "signalised-junction"
    page.keyboard.press("x")
    expect(tiles).to_have_count(7)
    page.wait_for_function(
        "document.activeElement.innerText.startsWith('winding-street')"
    )
    # No key reaches the scene.
    for key in ("p", "r", "Delete", "Control+z", " "):
        page.keyboard.press(key)
    assert editor.tab().ui.model.mode is None
    assert not editor.session.entries
    assert not workspace.playback.is_playing

    page.keyboard.press("/")
    page.keyboard.type("roundabout")
    expect(tiles).to_have_count(1)
    page.keyboard.press("Enter")
    page.wait_for_function("document.activeElement.matches('.pd-start-tile')")
    page.keyboard.press("Enter")
    expect(whole).to_be_hidden()
    assert editor.session.base.scenario_id == "roundabout"
    editor.until(lambda: workspace.playback.is_playing, "a scene that plays")
    expect(page.get_by_role("toolbar", name="Tools")).to_be_visible()

    page.get_by_role("button", name="All scenarios (N)").click()
    expect(tiles).to_have_count(1)
    expect(page.locator("[aria-current=true]", has_text="roundabout")).to_be_visible()


@pytest.mark.slow
def test_a_reload_keeps_the_page_and_escape_leaves_it(open_editor):
    editor = open_editor(reference=None)
    page = editor.page
    whole = page.get_by_role("region", name="All scenarios")
    expect(whole).to_be_visible()
    editor.reload()
    expect(whole).to_be_visible()
    page.keyboard.press("Escape")
    expect(whole).to_be_hidden()
    editor.reload()
    expect(page.get_by_role("toolbar", name="Tools")).to_be_visible()
    assert not whole.is_visible()
    assert editor.session.base.scenario_id == "signalised-junction"


def test_what_can_be_asked_for_is_whole_beside_the_panel(open_editor):
    """The last of what happens was cut by the panel at this width."""
    editor = open_editor(reference=None)
    page = editor.page
    page.set_viewport_size({"width": 1280, "height": 720})
    page.wait_for_function("document.activeElement.matches('.pd-start-tile')")
    page.keyboard.press("s")
    page.get_by_role("tab", name="Library 1").click()
    asked = page.get_by_role("group", name="What happens")
    expect(asked.get_by_role("button")).to_have_count(10)
    assert asked.evaluate("one => one.scrollWidth <= one.clientWidth")
