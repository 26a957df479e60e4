"""Rolling out in a real browser, by mouse and keyboard."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def editor(open_editor):
    """A small demo at t = 0, with the tab Drive open."""
    page = open_editor(reference="roundabout")
    page.go_to_now()
    page.open_tab("Drive")
    return page


def is_running(editor) -> bool:
    return editor.tab().ui.model.is_running


def test_roll_out_cancel_undo_and_redo(editor):
    opened, playback = editor.session.scenario, editor.workspace.playback
    roll_out = editor.page.get_by_role("button", name="Roll out", exact=True)

    editor.choose("Duration", "60 s")
    roll_out.click()
    editor.until(lambda: is_running(editor), "a run")
    expect(roll_out).to_be_disabled()
    editor.page.locator(".pd-chip").get_by_role("button", name="Cancel").click()
    editor.until(lambda: not is_running(editor), "its end")
    assert editor.session.scenario is opened
    assert not editor.session.entries

    editor.choose("Duration", "10 s")
    expect(roll_out).to_be_enabled()
    roll_out.click()
    editor.until(lambda: editor.session.entries, "a roll-out", 180)
    (entry,) = editor.session.entries
    assert entry.command.policies == {"AV": "idm"}
    rolled = editor.session.scenario
    assert rolled.time_axis.num_steps == opened.current_step + 101
    expect(editor.page.get_by_text("10 s rolled out", exact=True)).to_be_visible()
    editor.seek(9.0)
    assert playback.step == rolled.current_step + 90

    editor.key("Control+z")
    editor.until(lambda: editor.session.scenario is opened, "undo")
    editor.until(lambda: playback.axis == opened.time_axis, "the former time")
    editor.key("Control+Shift+z")
    editor.until(lambda: editor.session.scenario is rolled, "redo")

    editor.seek(4.0)
    editor.press("Start from here")
    editor.until(lambda: editor.session.scenario is not rolled, "a branch")
    begun = editor.session.scenario
    assert editor.session.entries[-1].label == "Start from t = 4 s"
    assert begun.time_axis.num_future_steps == 60
    editor.until(lambda: playback.axis == begun.time_axis, "its time")
    assert playback.step == begun.current_step
    editor.key("Control+z")
    editor.until(lambda: editor.session.scenario is rolled, "undo of the branch")
    editor.until(lambda: playback.axis == rolled.time_axis, "the former time")

    editor.key("Space")
    editor.until(lambda: playback.is_playing, "playback")
    editor.until(lambda: playback.step > opened.current_step + 5, "its time")
