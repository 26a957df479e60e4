"""The strip of samples in a real browser: preview, adopt, compare and undo by the mouse."""

import numpy as np
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def editor(open_editor):
    """The demo at t = 0, with the tab of the generator open."""
    page = open_editor()
    page.go_to_now()
    page.open_tab("Generate")
    return page


def regenerated(editor, count: int = 4) -> None:
    """A run of several samples, and its strip."""
    editor.set_number("Samples", count)
    editor.key("r")
    editor.until(lambda: editor.session.entries, "a run", 120)
    strip(editor).wait_for(state="visible")
    editor.until(lambda: cards(editor).count() == count, "cards")


def strip(editor):
    return editor.page.get_by_role("region", name="Samples", exact=True)


def cards(editor):
    return strip(editor).get_by_role("listbox").get_by_role("option")


def card(editor, number: int):
    return strip(editor).get_by_role("option", name=f"Sample {number}", exact=True)


def is_on_top(element) -> bool:
    """Whether nothing covers an element's corners."""
    return element.evaluate(
        "one => { const r = one.getBoundingClientRect();"
        " return [[r.left + 4, r.top + 4], [r.right - 4, r.bottom - 4],"
        " [r.left + 4, r.bottom - 4], [r.right - 4, r.top + 4]]"
        ".every(([x, y]) => document.elementFromPoint(x, y) === one); }"
    )


def labels(editor) -> list[str]:
    return [one.label.split(" (")[0] for one in editor.session.entries]


def drawn_end(editor) -> np.ndarray:
    """Positions of all agents in the picture."""
    return editor.tab().ui.model.poses.position_m


def test_samples_are_previewed_adopted_and_undone(editor):
    session = editor.session
    opened = session.scenario
    regenerated(editor)
    first = session.scenario
    expect(card(editor, 1)).to_have_attribute("aria-selected", "true")
    # The one in use kept its rank to itself.
    ranks = cards(editor).locator(".pd-sample-rank").all_inner_texts()
    assert sorted(one.split()[-1] for one in ranks) == ["1.", "2.", "3.", "4."]
    assert [one for one in ranks if "in use" in one] == [
        card(editor, 1).locator(".pd-sample-rank").inner_text()
    ]
    shown = card(editor, 2).inner_text()
    assert "problem" in shown
    assert "% move" in shown
    editor.seek(3.0)
    before = drawn_end(editor).copy()

    # Pointing shows another sample in the scene, and is no edit.
    card(editor, 3).hover()
    editor.until(lambda: editor.tab().ui.model.sample is not None, "a preview")
    editor.until(lambda: not np.array_equal(drawn_end(editor), before), "its agents")
    assert session.scenario is first
    assert len(session.entries) == 1
    editor.screenshot("samples_preview")
    previewed = editor.tab().ui.model.sample
    editor.page.mouse.move(300, 60)
    editor.until(lambda: np.array_equal(drawn_end(editor), before), "the end of it")

    # C compares what is pointed at, wherever the focus is.
    card(editor, 3).hover()
    editor.key("c")
    pair = editor.page.get_by_role("dialog", name="Comparison with another sample")
    pair.wait_for(state="visible")
    right = pair.get_by_role("combobox", name="On the right")
    expect(right).to_have_value("2")
    editor.key("c")
    pair.wait_for(state="hidden")
    # (A white band stayed over the top of the picture.)
    looks = "all => all.map(one => getComputedStyle(one).display)"
    assert set(editor.page.locator(".pd-element").evaluate_all(looks)) <= {
        "contents",
        "none",
    }

    # A click adopts it, another one replaces it: one entry.
    card(editor, 3).click()
    editor.until(lambda: labels(editor)[0].endswith("sample 3 of 4"), "sample 3")
    assert np.array_equal(
        session.scenario.agents.position_m, previewed.agents.position_m
    )
    card(editor, 2).click()
    editor.until(lambda: labels(editor)[0].endswith("sample 2 of 4"), "sample 2")
    assert len(session.entries) == 1
    editor.until(
        lambda: card(editor, 2).get_attribute("aria-selected") == "true", "the mark"
    )

    # Undo goes back to before the run; the strip stays, and any sample can be taken.
    editor.key("Control+z")
    editor.until(lambda: session.scenario is opened, "undo")
    card(editor, 4).click()
    editor.until(lambda: labels(editor)[-1].endswith("sample 4 of 4"), "sample 4")
    assert len(session.entries) == 1

    # Another edit hides it, undoing that edit shows it again.
    editor.press("Clear the road")
    editor.until(lambda: len(session.entries) == 2, "an edit")
    strip(editor).wait_for(state="hidden")
    editor.key("Control+z")
    strip(editor).wait_for(state="visible")


@pytest.mark.slow
def test_samples_by_keys_ranking_and_choice(editor):
    regenerated(editor, 5)
    page, session = editor.page, editor.session
    editor.key("Shift+J")
    page.wait_for_function("document.activeElement.classList.contains('pd-sample')")
    # The sample in use may be ranked last, from where no key leads on.
    page.keyboard.press("Home")
    at = page.evaluate("document.activeElement.dataset.index")
    page.keyboard.press("ArrowRight")
    page.wait_for_function(f"document.activeElement.dataset.index !== '{at}'")
    number = int(page.evaluate("document.activeElement.dataset.index")) + 1
    editor.until(lambda: editor.tab().ui.model.sample is not None, "a preview")
    page.keyboard.press("Enter")
    editor.until(
        lambda: labels(editor)[0].endswith(f"sample {number} of 5"), "the sample"
    )
    assert len(session.entries) == 1

    strip(editor).get_by_role("combobox", name="Order of the samples").select_option(
        "movement"
    )
    numbers = editor.tab().elements.samples._cards.numbers
    most = max(
        range(5), key=lambda n: numbers[n].moving_share * numbers[n].mean_speed_mps
    )
    editor.until(
        lambda: cards(editor).first.get_attribute("aria-label") == f"Sample {most + 1}",
        "the order",
    )
    strip(editor).get_by_role("combobox", name="Samples shown").select_option("2")
    editor.until(lambda: cards(editor).count() == 2, "the diverse ones")
    cards(editor).first.click()
    page.keyboard.press("Escape")
    strip(editor).wait_for(state="hidden")
    editor.key("Shift+J")
    strip(editor).wait_for(state="visible")
    editor.reload()
    expect(strip(editor)).to_be_hidden()


@pytest.mark.slow
def test_resampled_agents_are_offered_as_samples(editor):
    session = editor.session
    editor.set_number("Samples", 2)
    editor.choose("Where", "In the middle of my view (125 m square)")
    editor.open_folder("How many")
    editor.fill("Vehicles", 3)
    for label in ("Pedestrians", "Buses", "Cyclists", "Motorcyclists"):
        editor.fill(label, 0)
    editor.run("Resample", "everybody")
    editor.until(lambda: session.entries, "agents", 120)
    editor.until(lambda: cards(editor).count() == 2, "cards")
    card(editor, 2).click()
    editor.until(lambda: "sample 2 of 2" in session.entries[-1].label, "sample 2")
    assert len(session.entries) == 1
    editor.screenshot("samples_resampled")
    card(editor, 1).hover()
    compare = "Compare with the one in use: Sample 1"
    strip(editor).get_by_role("button", name=compare).click()
    pair = editor.page.get_by_role("dialog", name="Comparison with another sample")
    pair.wait_for(state="visible")
    left = pair.get_by_role("combobox", name="On the left")
    right = pair.get_by_role("combobox", name="On the right")
    expect(left).to_have_value("1")
    expect(right).to_have_value("0")
    right.select_option("1")
    editor.until(lambda: left.input_value() == "0", "the sides to change places")
    # The scorecard covers no part of it, and its list is as long as its text.
    drawer = editor.page.get_by_role("region", name="Scorecard")
    for width in (1440, 1000):
        editor.page.set_viewport_size({"width": width, "height": 900})
        if width == 1440:
            editor.key("i")
            drawer.wait_for()
        for canvas in pair.locator("canvas").all():
            editor.until(lambda one=canvas: is_on_top(one), "a canvas in sight")
    editor.key("i")
    drawer.wait_for(state="hidden")
    editor.page.set_viewport_size({"width": 1000, "height": 640})
    editor.screenshot("samples_side_by_side")
    pair.get_by_role("button", name="Use this sample").click()
    editor.until(lambda: "sample 1 of 2" in session.entries[-1].label, "sample 1")
    pair.wait_for(state="hidden")
    assert len(session.entries) == 1
    card(editor, 2).hover()
    keep = strip(editor).get_by_role(
        "button", name="Use and save to the library: Sample 2"
    )
    keep.click()
    editor.until(lambda: editor.workspace.library.cards(), "a saved scenario")
    # (After a comparison, no notice was seen any more.)
    notice = editor.page.locator(".mantine-Notification-title").last
    expect(notice).to_be_visible()
    # A single sample needs no choice.
    editor.set_number("Samples", 1)
    editor.key("r")
    editor.until(lambda: len(session.entries) == 2, "a run of one", 120)
    strip(editor).wait_for(state="hidden")


def test_six_samples_are_in_sight_beside_the_panel(editor):
    """Of six, the fifth was the last to be seen at this width."""
    editor.page.set_viewport_size({"width": 1280, "height": 720})
    regenerated(editor, 6)
    end = strip(editor).bounding_box()
    for one in cards(editor).all():
        box = one.bounding_box()
        assert box["x"] + box["width"] <= end["x"] + end["width"]
        assert is_on_top(one)


@pytest.mark.slow
def test_a_card_that_is_drawn_anew_while_it_is_pressed_takes_the_click(editor):
    """On a busy machine, clicks on cards and tiles went nowhere."""
    regenerated(editor)
    page, state = editor.page, editor.shown("samples")
    card(editor, 3).hover()
    page.mouse.down()
    page.evaluate('state => pdOverlay.update("samples", state)', state | {"title": "X"})
    page.mouse.up()
    editor.until(lambda: labels(editor)[0].endswith("sample 3 of 4"), "sample 3")
    expect(strip(editor).locator(".pd-samples-title")).not_to_have_text("X")
