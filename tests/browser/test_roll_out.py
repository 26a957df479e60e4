"""Rolling out in a real browser, by mouse and keyboard."""

import threading

import pytest
from playwright.sync_api import expect

from pd_editor.experiments.closed_loop.policies import IdmOnRoute

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    """A small demo at t = 0, with the tab Drive open."""
    page = open_editor(reference="roundabout")
    page.go_to_now()
    page.open_tab("Generate")
    return page


def is_running(editor) -> bool:
    return editor.tab().ui.model.is_running


def until_shown(editor, scenario, what: str) -> None:
    """Wait until the session has a scenario, and the page the scenario's time."""
    editor.until(lambda: editor.session.scenario is scenario, what)
    axis = scenario.time_axis
    editor.until(lambda: editor.workspace.playback.axis == axis, f"the time of {what}")
    slider = editor.page.get_by_role("slider", name="Time", exact=True)
    expect(slider).to_have_attribute("aria-valuemax", f"{axis.times_s()[-1]:.1f}")


def test_roll_out_cancel_undo_and_redo(editor, monkeypatch):
    editor.open_folder("Roll out in closed loop")
    opened, playback = editor.session.scenario, editor.workspace.playback
    roll_out = editor.page.get_by_role("button", name="Roll out", exact=True)

    # The policy answers after the cancel, so that the run is never over before.
    plan, go_on = IdmOnRoute.plan, threading.Event()
    monkeypatch.setattr(
        IdmOnRoute, "plan", lambda one, seen: (go_on.wait(180), plan(one, seen))[1]
    )
    editor.choose("Duration", "10 s")
    roll_out.click()
    editor.until(lambda: is_running(editor), "a run")
    expect(roll_out).to_be_disabled()
    editor.run_bar.get_by_role("button", name="Cancel").click()
    editor.until(lambda: not is_running(editor), "its end")
    go_on.set()
    assert editor.session.scenario is opened
    assert not editor.session.entries

    expect(roll_out).to_be_enabled()
    roll_out.click()
    editor.until(lambda: editor.session.entries, "a roll-out", 180)
    (entry,) = editor.session.entries
    assert entry.command.policies == {"AV": "idm"}
    rolled = editor.session.scenario
    assert rolled.time_axis.num_steps == opened.current_step + 101
    until_shown(editor, rolled, "the roll-out")
    expect(editor.page.get_by_text("10 s rolled out in")).to_have_count(1)
    editor.seek(9.0)
    assert playback.step == rolled.current_step + 90
    editor.until(lambda: editor.tab().elements.plans.shown, "the plan")

    editor.key("Control+z")
    until_shown(editor, opened, "undo")
    editor.key("Control+Shift+z")
    until_shown(editor, rolled, "redo")

    editor.seek(4.0)
    editor.press("Start from here")
    editor.until(lambda: len(editor.session.entries) == 2, "a branch")
    begun = editor.session.scenario
    assert editor.session.entries[-1].label == "Start from t = 4 s"
    assert begun.time_axis.num_future_steps == 60
    until_shown(editor, begun, "the branch")
    assert playback.step == begun.current_step
    editor.key("Control+z")
    until_shown(editor, rolled, "undo of the branch")

    editor.key("Space")
    editor.until(lambda: playback.is_playing, "playback")
    editor.until(lambda: playback.step > opened.current_step + 5, "its time")
