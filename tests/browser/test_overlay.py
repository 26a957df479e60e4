"""The overlay in a real page: it starts, follows the picture, answers."""

import numpy as np
import pytest
from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def test_the_overlay_covers_the_picture_and_agrees_on_where_things_are(open_editor):
    editor = open_editor()
    editor.until(lambda: editor.tab().ui.overlay.is_ready, "the overlay's first word")
    editor.until(lambda: "signalised-junction" in editor.page.title(), "the title")
    editor.go_to_now()
    editor.settle()
    boxes = editor.page.evaluate(
        "[document.getElementById('pd-overlay'), __viserMutable.canvas].map(e => {"
        " const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })"
    )
    assert np.allclose(boxes[0], boxes[1], atol=1.0)
    scenario = editor.session.scenario
    row = scenario.agents.row_of[scenario.focal_id]
    x, y = scenario.agents.position_m[row, scenario.current_step]
    expected = editor.pixel((x, y, 0.0))
    found = editor.page.evaluate(f"pdOverlay.project([{x}, {y}, 0])")
    assert np.allclose(np.array(found) + boxes[1][:2], expected, atol=2.0)
    ground = editor.page.evaluate(f"pdOverlay.ground({found[0]}, {found[1]})")
    assert np.allclose(ground, [x, y], atol=0.05)


def test_a_reload_leaves_one_overlay(open_editor):
    editor = open_editor()
    editor.reload()
    editor.until(lambda: editor.tab().ui.overlay.is_ready, "the overlay again")
    expect(editor.page.locator("#pd-overlay")).to_have_count(1)


def test_the_theme_is_the_browsers_until_one_is_chosen_and_kept(browser, open_editor):
    """It was light in a dark browser, and a choice was lost with the session."""
    with browser.new_context(color_scheme="dark") as context:
        editor = open_editor(context=context)
        editor.until(lambda: editor.workspace.is_dark, "the browser's theme")
        editor.open_tab("View")
        box = editor.row("Dark theme").locator("input[type=checkbox]").first
        expect(box).to_be_checked()
        editor.page.emulate_media(color_scheme="light")
        editor.until(lambda: not editor.workspace.is_dark, "the browser's new theme")
        expect(box).not_to_be_checked()
        editor.page.emulate_media(color_scheme="dark")
        editor.until(lambda: editor.workspace.is_dark, "the former one")
        # Before, a press on a slow page chose what the server had already.
        expect(box).to_be_checked()

        editor.tick("Dark theme")
        editor.until(lambda: not editor.workspace.is_dark, "the chosen theme")
        editor.page.wait_for_function("localStorage.getItem('pd-editor-dark') !== null")
        editor.workspace.is_dark = True  # as in a session of another day
        editor.reload()
        editor.until(lambda: not editor.workspace.is_dark, "the theme that was kept")


def test_what_is_told_twice_stands_there_once(open_editor):
    """A server that came back told again what the one before had told."""
    editor = open_editor()
    for title in ("Unfinished work found", "Something else", "Unfinished work found"):
        editor.tab().ui.notify(title, stays=True)
    expect(editor.page.get_by_text("Something else")).to_be_visible()
    told = editor.page.get_by_text("Unfinished work found")
    expect(told.filter(visible=True)).to_have_count(1)
    editor.page.wait_for_timeout(500)
    expect(told.filter(visible=True)).to_have_count(1)


def test_all_commands_can_be_searched_from_a_text_field(open_editor):
    """Ctrl+K did nothing there, and what was typed next went into the field."""
    editor = open_editor()
    editor.key("Control+f")
    search = editor.page.get_by_placeholder("Search by id, kind, focal, ego")
    expect(search).to_be_focused()
    editor.page.keyboard.press("Control+k")
    commands = editor.page.get_by_placeholder("Search commands...")
    expect(commands).to_be_focused()
    editor.page.keyboard.type("resam")
    expect(commands).to_have_value("resam")
    expect(search).to_have_value("")
