"""The strip of branches in a real browser, by mouse and keys, on a real bend."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.base.installed_files import demo_names
from pd_editor.editor.commands import DeleteAgents

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    """The demo at t = 0."""
    page = open_editor()
    page.go_to_now()
    return page


def strip(editor):
    return editor.page.get_by_role("region", name="Branches", exact=True)


def cards(editor):
    return strip(editor).get_by_role("option")


def test_back_to_the_recording_and_another_edit_keeps_the_first(editor):
    """Undone edits were lost with the next one; now both stay and are a click apart."""
    session, page = editor.session, editor.page
    opened = session.scenario
    editor.open_tab("Generate")
    editor.press("Clear the road")
    editor.until(lambda: session.state.position == 1, "an edit")
    cleared = session.scenario
    editor.key("Control+z")
    editor.until(lambda: session.scenario is opened, "undo")
    editor.key("r")
    editor.until(lambda: session.state.position == 1, "a run", 120)
    regenerated = session.scenario
    editor.open_tab("History")
    page.get_by_role("button", name="Branches: 3").click()
    expect(cards(editor)).to_have_count(3)
    expect(cards(editor).nth(2)).to_have_attribute("aria-selected", "true")
    editor.until(
        lambda: all(
            (one.get_attribute("src") or "").startswith("data:")
            for one in strip(editor).locator("img").all()
        ),
        "the pictures",
    )

    # Pointing previews; a click switches.
    cards(editor).nth(1).hover()
    editor.until(lambda: editor.tab().ui.model.sample is cleared, "a preview")
    assert session.scenario is regenerated
    editor.screenshot("branches_preview")
    cards(editor).nth(1).click()
    editor.until(lambda: session.scenario is cleared, "the first branch")
    expect(cards(editor).nth(1)).to_have_attribute("aria-selected", "true")
    cards(editor).nth(0).click()
    editor.until(lambda: session.scenario is opened, "the recording")

    # C compares two on one clock; another one is chosen and used there.
    cards(editor).nth(2).hover()
    editor.key("c")
    pair = page.get_by_role("dialog", name="Comparison with another branch")
    pair.wait_for(state="visible")
    expect(pair.get_by_role("combobox", name="On the right")).to_have_value("2")
    editor.screenshot("branches_side_by_side")
    pair.get_by_role("button", name="Use this branch").click()
    editor.until(lambda: session.scenario is regenerated, "the second branch")
    pair.wait_for(state="hidden")

    # One that is deleted can be put back.
    cards(editor).nth(1).hover()
    strip(editor).get_by_role("button", name="Delete: ").click()
    expect(cards(editor)).to_have_count(2)
    strip(editor).get_by_role("button", name="Put back 1 deleted").click()
    expect(cards(editor)).to_have_count(3)
    # Both leave the recording, as the lines over the cards say.
    assert (
        strip(editor).locator(".pd-strip-tree path").get_attribute("d").count("M") == 2
    )

    # One that is carried to other scenes is used, and the panel asks which ones.
    cards(editor).nth(2).hover()
    strip(editor).get_by_role("button", name="On other scenes: Regenerate").click()
    editor.until(lambda: session.scenario is regenerated, "the branch")
    editor.choose("Make in", "All demos")
    editor.press("Make family")
    library, count = editor.workspace.library, len(demo_names())
    editor.until(lambda: len(library.cards()) == count, "a variant of each demo", 120)
    page.get_by_text(f"{count} of {count} variants saved to the library (N)").wait_for()
    editor.screenshot("branches_on_other_scenes")
    page.mouse.move(300, 60)
    editor.key("Escape")
    strip(editor).wait_for(state="hidden")

    # All of them survive a reload, by keys alone.
    editor.reload()
    editor.key("u")
    expect(cards(editor)).to_have_count(3)
    page.wait_for_function("document.activeElement.classList.contains('pd-sample')")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Enter")
    editor.until(
        lambda: np.array_equal(
            editor.session.scenario.agents.position_m,
            cleared.agents.position_m,
            equal_nan=True,
        ),
        "the first branch",
    )


def test_a_branch_is_named_and_deleted_by_keys(editor):
    """Cards could not be renamed, and Delete deleted the selected agents."""
    session, page = editor.session, editor.page
    post = editor.tab().ui.post
    for name in session.scenario.agents.ids[:2]:
        post(lambda: session.jump_to(0))
        post(lambda name=name: session.apply(DeleteAgents(agent_ids=(name,))))
    editor.until(lambda: len(session.branches) == 3, "two branches")
    editor.key("u")
    expect(cards(editor)).to_have_count(3)
    page.wait_for_function("document.activeElement.classList.contains('pd-sample')")
    page.keyboard.press("ArrowLeft")
    expect(cards(editor).nth(1)).to_be_focused()
    page.keyboard.press("F2")
    field = strip(editor).get_by_role("textbox", name="Name of the branch")
    expect(field).to_be_focused()
    page.keyboard.type("not this")
    page.keyboard.press("Escape")
    expect(field).to_be_hidden()
    expect(cards(editor).nth(1)).to_be_focused()
    page.keyboard.press("F2")
    page.keyboard.type("first try")
    page.keyboard.press("Enter")
    expect(cards(editor).nth(1)).to_contain_text("first-try")
    expect(cards(editor).nth(1)).to_have_attribute("aria-selected", "true")
    assert session.name == "first-try"
    expect(cards(editor).nth(1)).to_be_focused()
    page.keyboard.press("ArrowRight")
    expect(cards(editor).nth(2)).to_be_focused()
    count = len(session.scenario.agents)
    page.keyboard.press("Delete")
    expect(cards(editor)).to_have_count(2)
    assert len(session.scenario.agents) == count
    cards(editor).nth(1).hover()
    strip(editor).get_by_role("button", name="Rename: first-try").click()
    expect(field).to_be_focused()
    editor.screenshot("branches_rename")
