"""The run bar by real mouse: in sight everywhere, named, with progress, result and cancel."""

import re
import threading

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.generation.path_diffuser import PathDiffuser

pytestmark = [pytest.mark.browser, pytest.mark.slow]

TABS = ("Scene", "Road", "Agents", "Generate", "Study", "History", "View")


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.page.set_viewport_size({"width": 1280, "height": 720})
    page.go_to_now()
    page.close_notifications()
    return page


def button(editor, verb: str):
    return editor.run_bar.locator(f".pd-run-{verb}")


def is_on_top(element) -> bool:
    """Whether an element's middle is in the window and nothing covers it."""
    return element.evaluate(
        "one => { const r = one.getBoundingClientRect();"
        " const at = document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2);"
        " return r.bottom <= innerHeight && (one === at || one.contains(at)); }"
    )


def test_the_bar_never_moves_and_nothing_covers_it(editor):
    """Regenerate was under the fold of one of eight tabs at this size."""
    page, session = editor.page, editor.session
    parts = [button(editor, verb) for verb in ("regenerate", "resample")]
    parts += [editor.run_bar.get_by_role("spinbutton", name="Samples")]
    still = [part.bounding_box() for part in parts]
    for tab in TABS:
        editor.open_tab(tab)
        assert all(map(is_on_top, parts)), tab
    # With the curve of speed, the list of problems and a drawer, it is where it was.
    editor.select((session.scenario.focal_id,))
    page.locator(".pd-chip-main").click()
    page.locator(".pd-problems.pd-solid").wait_for()
    editor.key("i")
    page.get_by_role("region", name="Scorecard").wait_for()
    assert all(map(is_on_top, parts))
    assert [part.bounding_box() for part in parts] == still
    for place in (".pd-timeline-bar", ".pd-chip", ".pd-scalebar"):
        assert page.locator(place).bounding_box()["y"] < still[0]["y"] - 40
    editor.screenshot("80_run_bar")


def test_it_names_whom_a_run_is_about(editor):
    session, page = editor.session, editor.page
    regenerate, resample = button(editor, "regenerate"), button(editor, "resample")
    expect(regenerate).to_have_text("Regenerate everybody")
    expect(resample).to_have_text("Resample everybody")
    told = editor.run_bar.get_by_role("status", name="Last run")
    expect(told).to_have_text(
        "Nothing reacts live: no agent is generated or guided yet"
    )
    now = session.scenario.current_step
    focal = session.scenario.agents.row_of[session.scenario.focal_id]
    place = session.scenario.agents.position_m[focal, now]
    editor.click_at((*place, 1.0))
    editor.until(lambda: session.selection, "a selection")
    expect(regenerate).to_have_text(f"Regenerate {session.selection[0]}")
    editor.key("Control+a")
    expect(regenerate).to_have_text(f"Regenerate {len(session.selection)} agents")
    editor.key("Escape")
    expect(regenerate).to_have_text("Regenerate everybody")

    editor.choose_scope("In the region I draw")
    editor.page.get_by_text("Drawing a region").first.wait_for()
    editor.drag(place + np.array([9.0, 9.0]), place - np.array([9.0, 9.0]))
    editor.until(lambda: editor.tab().elements.region.region, "a region")
    expect(regenerate).to_have_text("Regenerate region")
    expect(resample).to_have_text("Resample region")
    page.get_by_role("button", name="Clear the region").click()
    expect(regenerate).to_have_text("Regenerate everybody")
    menu = editor.run_bar.get_by_role("combobox", name="Agents to regenerate")
    expect(menu).to_have_value("The selection, else the guided, else all")


def test_a_run_tells_its_progress_and_result_and_is_cancelled(editor, monkeypatch):
    session = editor.session
    told = editor.run_bar.get_by_role("status", name="Last run")
    progress = editor.run_bar.get_by_role("progressbar", name="Progress")
    generate, go_on = PathDiffuser.generate, threading.Event()

    def slowly(diffuser, request):
        steps = generate(diffuser, request)
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                return end.value
            yield step
            go_on.wait(0.5)

    monkeypatch.setattr(PathDiffuser, "generate", slowly)
    editor.select((session.scenario.focal_id,))
    editor.set_number("Samples", 99)
    samples = editor.run_bar.get_by_role("spinbutton", name="Samples")
    expect(samples).to_have_value("16")
    editor.set_number("Samples", 1)
    editor.set_number("Seed", 41)
    button(editor, "regenerate").click()
    expect(progress).to_be_visible()
    expect(button(editor, "regenerate")).to_be_disabled()
    expect(button(editor, "resample")).to_be_disabled()
    editor.run_bar.get_by_role("button", name="Cancel").click()
    expect(told).to_have_text("Cancelled.")
    expect(progress).to_be_hidden()
    assert not session.entries

    go_on.set()
    button(editor, "regenerate").click()
    editor.until(lambda: session.entries, "a trajectory", 120)
    assert "seed 42" in session.entries[0].label
    expect(told).to_contain_text("1 agent in")
    expect(told).to_have_text(re.compile(r"seed 42\. Mean distance to [^.]*\.\d m\.$"))
    expect(editor.run_bar.get_by_role("spinbutton", name="Seed")).to_have_value("43")

    # A refusal is told as well, until something else is selected.
    editor.open_tab("Generate")
    editor.choose("Replace", "The selection")
    editor.select(())
    expect(button(editor, "resample")).to_have_text("Resample no agents")
    button(editor, "resample").click()
    expect(told).to_contain_text("Nothing is selected")
    editor.select((session.scenario.focal_id,))
    expect(told).not_to_contain_text("Nothing is selected")
    assert len(session.entries) == 1


LONG = "3 agents slowed down to avoid a collision: 4185, 4197, 4198."


@pytest.mark.parametrize("width", [1000, 1280, 1440])
def test_what_must_be_known_is_readable_at_every_width(editor, width):
    """Of 933 px of words 117 px were shown, and buttons lost whom they are about."""
    page, bar = editor.page, editor.run_bar
    page.set_viewport_size({"width": width, "height": 720})
    editor.settle()
    places = [bar, *(button(editor, verb) for verb in ("regenerate", "resample"))]
    still = [place.bounding_box() for place in places]
    panel = editor.tab().elements.generation
    said = f"{LONG} 28 agents in 0.4 s, seed 5. {'Mean distance to lanes: 0.8 m. ' * 6}"
    panel.result.said = said
    editor.tab().ui.post(panel.result.changed.emit)
    told = bar.get_by_role("status", name="Last run")
    expect(told).to_contain_text("Mean distance")
    shown = told.evaluate(
        "(one, end) => { const range = document.createRange();"
        " range.setStart(one.firstChild, 0); range.setEnd(one.firstChild, end);"
        " return range.getBoundingClientRect().right"
        " <= one.getBoundingClientRect().right; }",
        len(LONG),
    )
    assert shown
    for place in places[1:]:
        assert place.evaluate(
            "one => [...one.children].every(e => e.scrollWidth <= e.clientWidth)"
        )
    assert [place.bounding_box() for place in places] == still
    told.click()
    page.mouse.move(400, 300)  # It stays without the mouse.
    whole = bar.locator(".pd-run-end").evaluate(
        "one => getComputedStyle(one, '::after').content"
    )
    assert said.strip() in whole
    assert bar.evaluate("one => getComputedStyle(one).zIndex") == "1", (
        "over the timeline"
    )
    editor.screenshot(f"run_bar_{width}")


SIX_SAMPLES = (
    "12 agents in 6 samples slowed down to avoid a collision. 1 of 347 placed agents in "
    "6 samples is off the road at t = 0. Sample 5: 57 of 58 new agents were placed; no "
    "free place was found for 1. 1 of 58 agents appears after the scene's start: others "
    "are in the way before. 58 agents in 12.1 s, seed 0."
)


@pytest.mark.parametrize("size", [(1280, 720), (1600, 900)])
def test_what_six_samples_have_told_is_read_without_pointing(editor, size):
    """Half of its words were cut."""
    editor.page.set_viewport_size({"width": size[0], "height": size[1]})
    result = editor.tab().elements.generation.result
    result.said = SIX_SAMPLES
    editor.tab().ui.post(result.changed.emit)
    told = editor.run_bar.get_by_role("status", name="Last run")
    expect(told).to_have_text(SIX_SAMPLES)
    assert told.evaluate("one => one.scrollHeight <= one.clientHeight")


def test_on_a_bare_road_the_button_to_press_stands_out(editor):
    """The blue one was Regenerate, which could not be pressed."""
    color = "one => getComputedStyle(one).backgroundColor"
    regenerate, resample = button(editor, "regenerate"), button(editor, "resample")
    main = regenerate.evaluate(color)
    assert resample.evaluate(color) != main
    editor.open_tab("Generate")
    editor.press("Clear the road")
    expect(resample).to_have_text("Fill road")
    editor.page.mouse.move(400, 300)
    expect(regenerate).to_be_disabled()
    assert resample.evaluate(color) == main
    editor.screenshot("run_bar_bare")
