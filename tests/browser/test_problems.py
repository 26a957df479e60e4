"""Status chip, list of problems and a panel that stands still, by real mouse."""

import re
import time

import msgspec
import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.editor.commands import DuplicateAgents, SetRoadWarp, TransformAgents
from pd_editor.editor.session import EditorSession
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.overlay.messages import StatusState

pytestmark = [pytest.mark.browser, pytest.mark.slow]
TABS = ("Scene", "Road", "Agents", "Generate", "Study", "History", "View")


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    return page


def bend(editor, power: float = 10.0) -> None:
    """A double turn that most agents are too fast for."""
    scenario = editor.session.scenario
    term = WarpTerm(kind="double-turn", power=power, length_m=10.0)
    warp = RoadWarp(anchor=pose_of_anchor(scenario, "focal"), terms=(term,))
    editor.tab().ui.post(lambda: editor.session.apply(SetRoadWarp(warp=warp)))
    editor.until(
        lambda: any(p.kind == "friction" for p in editor.tab().ui.model.findings.new),
        "agents over the friction limit",
    )


def chip(editor) -> str:
    return editor.page.get_by_role("status", name="Status").inner_text()


def rows(editor):
    return editor.page.locator(".pd-problem-row")


def boxes(editor, tabs=TABS) -> dict:
    """Where every control of every tab is, by tab: tag, name, x, y, height.

    Places are those in the panel, however far it is scrolled; its tabs do not scroll.
    The first one is the panel's length: one that gets shorter is scrolled by the browser.
    """
    found = {}
    for name in tabs:
        editor.open_tab(name)
        # A slider's thumb moves along its track by what it shows; up and down never.
        places = editor.page.evaluate(
            "(() => {"
            " const panel = [...document.querySelectorAll('[data-scrollarea-viewport]')]"
            "  .find(e => e.querySelector('[role=tab]'));"
            " const controls = [...document.querySelectorAll("
            "  'button, input:not([type=hidden]), [role=slider], [role=tab]')]"
            "  .filter(e => !e.closest('#pd-overlay') && e.offsetParent"
            "   && !e.closest('.mantine-Notification-root'));"
            " return [['PANEL', '', 0, 0, panel.scrollHeight], ...controls.map(e => {"
            "  const r = e.getBoundingClientRect();"
            "  const scrolls = panel.contains(e) && e.role !== 'tab';"
            "  const scrolled = scrolls ? panel.scrollTop : 0;"
            "  return [e.tagName, e.innerText || e.ariaLabel || e.type,"
            "   e.role === 'slider' ? 0 : r.x, r.y + scrolled, r.height]; })];"
            " })()"
        )
        found[name] = [tuple(place) for place in places]
    return found


def assert_still(after: list, before: list, name: str) -> None:
    """The same controls in the same places; rows of the history may be added below."""
    moved = [old for old in before[1:] if not any(same(old, new) for new in after[1:])]
    assert not moved, (name, moved)
    if len(after) == len(before):
        assert same(after[0], before[0]), (name, after[0], before[0])
    else:
        assert after[0][-1] >= before[0][-1], (name, after[0], before[0])


def same(old: tuple, new: tuple) -> bool:
    """Names may change, as rows of the history do; to a fifth of a pixel, places not."""
    return old[0] == new[0] and np.allclose(old[2:], new[2:], atol=0.2)


def test_a_row_selects_frames_and_goes_to_its_time_and_is_cured(editor):
    """(D10, D13, D24) Chip, list, ticks, rings and a cure that is one undo step."""
    page, session = editor.page, editor.session
    playback, watch = editor.workspace.playback, editor.tab().ui.model.findings
    editor.until(lambda: chip(editor) == "No new problems", "a green chip")
    before = page.locator(".pd-chip").bounding_box()
    bend(editor)
    count = len(watch.new)
    editor.until(lambda: chip(editor) == f"{count} problems", "an orange chip")
    assert page.locator(".pd-chip").bounding_box() == before
    assert before["width"] == 280
    assert before["height"] == 36

    page.locator(".pd-chip-main").click()
    expect(rows(editor)).to_have_count(count)
    # Few rows leave no empty room below them.
    shown = page.locator(".pd-problem-rows")
    used = shown.evaluate("one => one.lastChild.offsetTop + one.lastChild.offsetHeight")
    top, height = shown.evaluate("one => [one.offsetTop, one.clientHeight]")
    assert height - (used - top) < 28
    editor.screenshot("16_problems")
    first, second = watch.new[:2]
    camera = np.array(editor.client.camera.position)
    rows(editor).nth(0).click()
    editor.until(lambda: session.selection == first.agent_ids, "a selection")
    editor.until(lambda: playback.step == first.first_step, "its time")
    editor.until(
        lambda: not np.allclose(camera, editor.client.camera.position), "its place"
    )
    assert set(first.agent_ids) <= watch.agents_at(playback.step)
    assert not watch.agents_at(0.0)
    page.keyboard.press("ArrowDown")
    editor.until(lambda: session.selection == second.agent_ids, "the next row")
    editor.until(lambda: playback.step == second.first_step, "its time")

    # A tick of the timeline leads there as well.
    last = watch.new[-1]
    name = f"Problem at {(last.first_step - session.scenario.current_step) / 10:.1f} s"
    page.get_by_role("button", name=name).click()
    editor.until(lambda: playback.step == last.first_step, "the tick's time")
    editor.until(lambda: session.selection == last.agent_ids, "the tick's agents")

    editor.press("Ignore")
    editor.until(lambda: chip(editor) == f"{count - 1} problems", "one ignored")
    page.get_by_role("button", name="1 ignored").click()
    rows(editor).last.click()
    editor.press("No longer ignore")
    editor.until(lambda: chip(editor) == f"{count} problems", "all again")

    num_edits = len(session.entries)
    page.get_by_role("button", name="to the limit").last.click()
    editor.until(lambda: len(session.entries) == num_edits + 1, "the cure")
    assert session.entries[-1].label == "Road: friction limit 0.7"
    editor.open_tab("Road")
    setting = editor.row("Slow agents to the friction limit")
    expect(setting.get_by_role("checkbox")).to_be_checked()
    editor.screenshot("16_slowed")
    editor.until(
        lambda: not any(p.kind == "friction" for p in watch.new), "no agent too fast"
    )
    editor.key("Control+z")
    editor.until(lambda: len(watch.new) == count, "the problems again")


def test_a_click_beside_a_tick_seeks_and_one_on_it_chooses(editor):
    """A tick took presses within 30 px, so that scrubbing chose problems and flew there."""
    page, session, playback = editor.page, editor.session, editor.workspace.playback
    bend(editor)
    last = editor.tab().ui.model.findings.new[-1]
    wanted = last.first_step
    name = f"Problem at {(wanted - session.scenario.current_step) / 10:.1f} s"
    tick = page.get_by_role("button", name=name).bounding_box()
    track = page.get_by_role("slider", name="Time", exact=True).bounding_box()
    x = tick["x"] + tick["width"] / 2
    middle = track["y"] + track["height"] / 2
    assert tick["y"] + tick["height"] < middle - 6
    for away in (0.0, -9.0, 9.0):
        page.mouse.click(x + away, middle)
        step = wanted + round(away * 109 / track["width"])
        editor.until(lambda step=step: abs(playback.step - step) <= 1, "the time")
    assert not session.selection
    page.mouse.click(x, tick["y"] + tick["height"] / 2)
    editor.until(lambda: session.selection == last.agent_ids, "the problem")


def test_of_two_quick_clicks_on_the_track_the_later_one_counts(editor):
    """The answer to the first moved the playhead back, to where the second then sought."""
    page, playback = editor.page, editor.workspace.playback
    now = editor.session.scenario.current_step
    track = page.get_by_role("slider", name="Time", exact=True).bounding_box()
    middle = track["y"] + track["height"] / 2
    for turn in range(8):
        wanted = (10, 30)[turn % 2] + turn
        for step in (50, wanted):
            x = track["x"] + (now + step) / 109 * track["width"]
            page.mouse.click(x, middle)
        editor.until(
            lambda at=now + wanted: abs(playback.step - at) <= 1, "the later click", 5
        )


def test_what_cannot_help_is_not_offered(editor):
    """(D13) A collision now is not cured by new futures; removing one agent helps."""
    session, watch = editor.session, editor.tab().ui.model.findings
    scenario = session.scenario
    focal = scenario.agents.row_of[scenario.focal_id]
    other = next(
        row
        for row in range(len(scenario.agents))
        if scenario.agents.is_valid[row, 49]
        and scenario.agents.kinds[row] == scenario.agents.kinds[focal]
        and scenario.agents.ids[row] not in (scenario.focal_id, "AV")
    )
    dx, dy = (
        scenario.agents.position_m[focal, 49] - scenario.agents.position_m[other, 49]
    )
    name = scenario.agents.ids[other]
    move = TransformAgents(agent_ids=(name,), dx_m=float(dx), dy_m=float(dy))
    editor.tab().ui.post(lambda: session.apply(move))
    editor.until(lambda: any(p.kind == "collision" for p in watch.new), "a collision")
    editor.page.locator(".pd-chip-main").click()
    editor.page.locator(".pd-problem-row", has_text="collide").first.click()
    cures = editor.page.locator(".pd-problem-cures button")
    editor.until(lambda: cures.count() >= 2, "what helps")
    texts = cures.all_inner_texts()
    assert not any("Regenerate" in text for text in texts)
    assert f"Remove {name}" in texts
    assert f"Remove {scenario.focal_id}" not in texts
    editor.press(f"Remove {name}")
    editor.until(
        lambda: not any(name in p.agent_ids for p in watch.new), "the collision gone"
    )


def test_nothing_in_a_panel_moves(editor):
    """(D4) Problems that come, a run and its report leave every control in place."""
    session = editor.session
    still = boxes(editor)
    bend(editor)
    for name, after in boxes(editor).items():
        assert_still(after, still[name], f"{name}, with problems")
    editor.open_tab("Generate")
    editor.run("Regenerate", "everybody")
    editor.until(lambda: len(session.entries) == 2, "futures", 120)
    for name, after in boxes(editor).items():
        assert_still(after, still[name], f"{name}, after a run")
    editor.key("Control+z")
    editor.until(lambda: session.state.position == 1, "undo")
    for name, after in boxes(editor).items():
        assert_still(after, still[name], f"{name}, after undo")


def test_a_run_from_another_tab_tells_progress_and_can_be_cancelled(
    editor, monkeypatch
):
    """(D25) R shows sample k of n and Cancel on the picture, whatever tab is open."""
    generate = PathDiffuser.generate

    def slowly(diffuser, request):
        steps = generate(diffuser, request)
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                return end.value
            time.sleep(0.05)
            yield step

    monkeypatch.setattr(PathDiffuser, "generate", slowly)
    editor.open_tab("Generate")
    editor.set_number("Samples", 16)
    editor.open_folder("Model settings")
    editor.fill("Denoising steps", 50)
    editor.open_tab("Scene")
    told = editor.run_bar.get_by_role("status", name="Last run")
    editor.key("r")
    expect(told).to_contain_text(re.compile("Sample .* of 16"))
    editor.run_bar.get_by_role("button", name="Cancel").click()
    expect(told).to_have_text("Cancelled.")
    assert not editor.tab().ui.model.is_running
    assert not editor.session.entries


def test_the_list_shows_every_cure_and_closes_by_escape(editor, monkeypatch):
    """Six actions fit; the hint steps aside; Escape closes and keeps the selection."""
    page, session = editor.page, editor.session
    bend(editor)
    hint = page.get_by_role("status", name="Hint")
    hint.wait_for()
    page.locator(".pd-chip-main").click()
    rows(editor).nth(0).click()
    page.get_by_role("button", name="Ignore", exact=True).wait_for()
    assert session.selection
    expect(hint).to_be_hidden()
    overlay = editor.tab().ui.overlay
    show = overlay.show
    # What is shown here stays until the end.
    monkeypatch.setattr(
        overlay, "show", lambda one: None if isinstance(one, StatusState) else show(one)
    )
    state = editor.shown("status")
    state["active"]["cures"] = [
        "Regenerate 131326",
        "Regenerate both",
        "Snap 131326 to its lane",
        "Snap 131600 to its lane",
        "Remove 131326",
        "Remove 131600",
    ]
    shown = msgspec.convert(state, StatusState)
    editor.tab().ui.post(lambda: show(shown))
    page.get_by_role("button", name="Remove 131600").wait_for()
    box = page.locator(".pd-problems").bounding_box()
    for name in (*state["active"]["cures"], "Ignore"):
        place = page.locator(".pd-problems").get_by_role(
            "button", name=name, exact=True
        )
        visible = place.evaluate(
            "e => { const r = e.getBoundingClientRect();"
            " return e.contains(document.elementFromPoint("
            "  r.x + r.width / 2, r.y + r.height - 4)); }"
        )
        assert visible, (name, box)
    page.locator(".pd-chip-main").click()
    page.locator(".pd-chip-main").click()
    page.keyboard.press("Escape")
    page.locator(".pd-problems").wait_for(state="hidden")
    assert session.selection


def test_escape_closes_the_list_with_the_focus_elsewhere(editor):
    """A mode ends first; then the list closes; then the selection is cleared."""
    page, session, tab = editor.page, editor.session, editor.tab()
    bend(editor)
    opened = page.locator(".pd-problems")
    mode = page.get_by_role("status", name="Mode")
    page.locator(".pd-chip-main").click()
    rows(editor).nth(0).click()
    editor.until(lambda: session.selection, "a selection")
    editor.key("p")
    expect(mode).to_contain_text("Placing")
    editor.key("Escape")
    expect(mode).to_be_hidden()
    expect(opened).to_be_visible()
    editor.key("Escape")
    expect(opened).to_be_hidden()
    assert session.selection
    # It opens again, and closes again.
    page.locator(".pd-chip-main").click()
    expect(opened).to_be_visible()
    editor.until(lambda: tab.elements.chip._is_open, "the server to know")
    editor.key("Escape")
    expect(opened).to_be_hidden()
    editor.key("Escape")
    editor.until(lambda: not session.selection, "no selection")


def test_twenty_problems_are_walked_by_mouse_and_keys(editor):
    """What a row leads to is in sight beside the list; keys walk, and nothing moves."""
    page, session, tab = editor.page, editor.session, editor.tab()
    page.set_viewport_size({"width": 1280, "height": 720})
    agents, now = session.scenario.agents, session.scenario.current_step
    copied = [
        n for n, there in zip(agents.ids, agents.is_valid[:, now], strict=True) if there
    ][:22]
    copy = DuplicateAgents(
        agent_ids=tuple(copied),
        new_ids=tuple(f"copy-{name}" for name in copied),
        dx_m=0.4,
    )
    checked: list[bool] = []
    tab.ui.model.checked.subscribe(lambda: checked.append(True))
    tab.ui.post(lambda: session.apply(copy))
    watch = tab.ui.model.findings
    editor.until(lambda: len(watch.new) >= 20, "twenty problems")
    editor.until(lambda: checked, "those of the future")
    tab.ui.post(lambda: session.select(()))
    page.locator(".pd-chip-main").click()
    places = [page.locator(name) for name in (".pd-problems", ".pd-problem-detail")]
    known = [problem.key for problem in watch.new]
    expect(rows(editor)).to_have_count(len(known))
    places[1].wait_for()
    still = [place.bounding_box() for place in places]

    def active() -> int | None:
        status = editor.shown("status")
        listed = [row["id"] for group in status["groups"] for row in group["rows"]]
        return status["active"] and listed.index(status["active"]["id"])

    # The focus is on the chip that opened the list: keys walk from there.
    page.keyboard.press("ArrowDown")
    editor.until(lambda: active() == 0, "the first row")
    for key, wanted in (("End", len(known) - 1), ("Home", 0)):
        page.keyboard.press(key)
        editor.until(lambda wanted=wanted: active() == wanted, key)
    page.keyboard.press("PageDown")
    editor.until(lambda: 2 < active() < len(known) - 1, "a page on")
    page.keyboard.press("PageUp")
    editor.until(lambda: active() == 0, "a page back")
    assert page.get_by_text("Not possible").count() == 0

    page.mouse.move(still[0]["x"] + 100, still[0]["y"] + 80)
    page.mouse.wheel(0, 4000)
    rows(editor).last.click()
    editor.until(lambda: active() == len(known) - 1, "the last row")
    editor.until(lambda: editor.shown("status")["active"]["cures"], "what helps")
    editor.settle()
    x, y = editor.pixel(watch.new[-1].place_m)
    assert x < still[0]["x"] - 40
    assert y < page.get_by_role("slider", name="Time", exact=True).bounding_box()["y"]

    # After a cure by the keyboard, keys go on from the same place of the list.
    page.get_by_role("button", name=f"Remove copy-{copied[-1]}").focus()
    page.keyboard.press("Enter")
    editor.until(lambda: len(watch.new) < len(known), "a cure")
    editor.until(lambda: rows(editor).count() == len(watch.new), "fewer rows")
    page.wait_for_function(
        "document.activeElement.classList.contains('pd-problem-row')"
    )
    page.keyboard.press("ArrowUp")
    editor.until(lambda: active() == len(watch.new) - 2, "the row above")
    assert [place.bounding_box() for place in places] == still


def test_a_report_leaves_with_its_result(editor):
    """(D31) A report that is stale."""
    editor.open_tab("Generate")
    editor.select((editor.session.scenario.focal_id,))
    editor.run("Regenerate", editor.session.scenario.focal_id)
    editor.until(lambda: len(editor.session.entries) == 1, "a future")
    report = editor.run_bar.get_by_role("status", name="Last run")
    expect(report).to_contain_text("1 agent in")
    editor.key("Control+z")
    expect(report).to_have_text(re.compile("Nothing reacts live"))


def test_edits_that_are_not_saved_are_told_as_long_as_they_are(editor, monkeypatch):
    """(reliability 6) Red, with a download at hand, until the disk takes edits again."""
    monkeypatch.setattr(
        EditorSession, "journal_problem", property(lambda _: "the disk is full.")
    )
    editor.tab().ui.post(editor.tab().elements.chip.show)
    alert = editor.page.get_by_role("alert").filter(has_text="Edits are not saved")
    alert.wait_for()
    expect(alert).to_contain_text("the disk is full")
    with editor.page.expect_download() as download:
        alert.get_by_role("button", name="Download").click()
    assert download.value.suggested_filename.endswith(".zip")
    monkeypatch.undo()
    editor.tab().ui.post(editor.tab().elements.chip.show)
    alert.wait_for(state="hidden")


def test_groups_of_problems_keep_the_focus(editor):
    """A group that keys opened or closed was drawn anew, and the focus was lost."""
    bend(editor)
    page = editor.page
    page.locator(".pd-chip-main").click()
    head = page.locator(".pd-problem-group").first
    head.focus()
    for is_open in ("false", "true"):
        expect(head).to_be_focused()
        page.keyboard.press("Enter")
        expect(head).to_have_attribute("aria-expanded", is_open)
    expect(head).to_be_focused()
