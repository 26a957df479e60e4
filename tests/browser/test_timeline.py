"""The timeline by real mouse and keyboard."""

import numpy as np
import pytest
from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    return page


def shown(editor) -> str:
    return editor.page.get_by_role("status", name="Time shown").inner_text()


def test_scrub_click_step_and_play(editor):
    """(D34, design 7) The track scrubs, arrow keys step a frame or ten, Space plays."""
    page, playback = editor.page, editor.workspace.playback
    track = page.get_by_role("slider", name="Time", exact=True)
    box = track.bounding_box()
    middle = box["y"] + box["height"] / 2
    camera = editor.client.camera.position.copy()

    editor.seek(2.0)
    assert playback.step == 69
    editor.until(lambda: shown(editor) == "2.0 s", "the time")
    for keys, step in (
        ("ArrowRight", 70),
        ("ArrowLeft", 69),
        ("Shift+ArrowRight", 79),
        ("Shift+ArrowLeft", 69),
    ):
        editor.key(keys)
        editor.until(lambda step=step: playback.step == step, f"step {step}")
    assert (editor.client.camera.position == camera).all()

    # With the focus as well, which Tab brings.
    page.get_by_role("button", name="t = 0", exact=True).focus()
    page.keyboard.press("Tab")
    expect(track).to_be_focused()
    for keys, step in (
        ("ArrowRight", 70),
        ("Home", 0),
        ("End", 109),
        ("Shift+ArrowLeft", 99),
        ("PageDown", 89),
        ("PageUp", 99),
    ):
        page.keyboard.press(keys)
        editor.until(lambda step=step: playback.step == step, f"step {step}")
    editor.seek(2.0)

    start = box["x"] + box["width"] * 69 / 109
    end = box["x"] + box["width"] * 20 / 109
    editor.drag_pixels((start, middle), (end, middle))
    editor.until(lambda: abs(playback.step - 20) <= 1, "the scrubbed time")
    assert playback.step == round(playback.step)
    editor.until(lambda: shown(editor).startswith("\u2212"), "a past time")
    assert not editor.session.entries
    assert not editor.session.selection

    editor.key("Space")
    before = playback.step
    editor.until(lambda: playback.step > before + 3, "playback")
    expect(page.get_by_role("button", name="Pause", exact=True)).to_have_count(1)
    editor.pause()
    editor.go_to_now()
    assert playback.step == playback.axis.current_step
    editor.until(lambda: shown(editor) == "0.0 s", "the time")


def test_the_playhead_runs_between_two_messages_of_the_server(editor):
    """(design 7) The page moves the playhead on every frame, not four times a second."""
    editor.go_to_now()
    editor.key("Space")
    editor.page.get_by_role("button", name="Pause", exact=True).wait_for()
    # Messages no longer arrive, so only the page itself can move it. However slowly a
    # busy machine draws, three places are seen.
    places = editor.page.evaluate(
        "new Promise(done => { const receive = pdOverlay.update;"
        " pdOverlay.update = () => {};"
        " const seen = new Set(), begin = performance.now();"
        " (function look() { seen.add(document.querySelector('.pd-knob').style.left);"
        " if (seen.size < 3 && performance.now() - begin < 20000) setTimeout(look, 10);"
        " else { pdOverlay.update = receive; done(seen.size); } })(); })"
    )
    assert places == 3


def test_keys_of_film_editors_play_back_pause_and_play(editor):
    """J, K, L: again is twice as fast; full stop and comma step a frame of 0.1 s."""
    playback, start = editor.workspace.playback, editor.workspace.playback.step
    editor.key("j")
    editor.until(lambda: playback.step < start - 3, "playback to the past")
    editor.page.get_by_role("button", name="Speed \u22121\u00d7").wait_for()
    editor.key("j")
    editor.page.get_by_role("button", name="Speed \u22122\u00d7").wait_for()
    editor.key("l")
    editor.page.get_by_role("button", name="Speed 1\u00d7").wait_for()
    assert (playback.direction, playback.speed) == (1, 1.0)
    editor.key("l")
    editor.until(lambda: playback.speed == 2.0, "twice the speed")
    editor.key("k")
    editor.until(lambda: not playback.is_playing, "a pause")
    assert not editor.session.scenario.locks
    editor.seek(1.0)
    for keys, step in ((".", 60), (",", 59)):
        editor.key(keys)
        editor.until(lambda step=step: playback.step == step, f"step {step}")


def test_speed_and_loop(editor):
    playback = editor.workspace.playback
    editor.press("Speed 1\u00d7")
    editor.until(lambda: playback.speed == 2.0, "twice the speed")
    editor.press("Loop")
    editor.until(lambda: not playback.loops, "no loop")
    editor.seek(5.5)
    editor.press("Play")
    editor.until(lambda: playback.step == 109, "the end")
    assert not playback.is_playing
    editor.until(lambda: shown(editor) == "6.0 s", "the end shown")


def test_a_speed_is_pulled_by_mouse_and_keys(editor):
    """(design 7) Two clicks set a speed: one selects, one pulls the curve; Escape gives up."""
    page, session = editor.page, editor.session
    scenario = session.scenario
    now, agents = scenario.current_step, scenario.agents
    lasts = agents.is_valid[:, now:].all(axis=1)
    speed = np.where(lasts, agents.speed_mps()[:, now:].min(axis=1), -1)
    row = int(speed.argmax())
    name = agents.ids[row]
    editor.tab().ui.post(lambda: session.select((name,)))
    curve = page.get_by_role("group", name=f"Speed of {name}")
    # In a window as low as this one it is folded at first.
    page.get_by_role("button", name="Curve of speed").click()
    curve.wait_for()
    track = page.get_by_role("slider", name="Time", exact=True).bounding_box()
    x = track["x"] + track["width"] * (now + 20) / (agents.num_steps - 1)
    y = curve.bounding_box()["y"] + 20

    def pulled() -> float:
        return float(session.scenario.agents.speed_mps()[row, now + 20])

    before = pulled()
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 12, steps=4)
    editor.until(lambda: pulled() < before - 1, "a slower preview")
    editor.key("Escape")
    editor.until(lambda: pulled() == before, "the pull to be given up")
    page.mouse.up()
    assert not session.entries

    editor.drag_pixels((x, y), (x, y + 12))
    editor.until(lambda: len(session.entries) == 1, "the pull in the history")
    slower = pulled()
    assert slower < before - 1
    assert editor.workspace.playback.step == now + 20
    assert session.entries[0].label.startswith(f"Pull agent {name} to {slower:.1f} m/s")

    curve.focus()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowUp")
    editor.until(lambda: len(session.entries) == 2, "the pull by keys")
    assert pulled() == pytest.approx(slower + 1, abs=0.06)

    def apart() -> float:
        """Pixels between t = 0 of the curve and of the track."""
        past, zero = (
            page.locator(one).bounding_box()
            for one in (".pd-speed-past", ".pd-second.pd-zero")
        )
        return abs(past["x"] + past["width"] - zero["x"] - zero["width"] / 2)

    editor.until(lambda: apart() < 2, "the curve over its track")
    # The picture gets the panel's place, and the window keeps its size.
    page.get_by_role("button", name="Collapse panel area").click()
    editor.until(lambda: curve.bounding_box()["width"] > 900, "a wide curve")
    editor.until(lambda: apart() < 2, "the curve over its wide track", 5)
    page.get_by_role("button", name="Curve of speed").click()
    expect(curve).to_be_hidden()
