"""Scenes found by what happens in them, by real mouse and keyboard."""

import shutil
from pathlib import Path

import pytest
from playwright.sync_api import expect

from pd_editor.base.installed_files import demo_folder
from pd_editor.experiments.scene_index.index_file import INDEX_NAME

pytestmark = [pytest.mark.browser, pytest.mark.slow]
DEMOS = ("crosswalk", "downtown", "merge", "roundabout", "winding-street")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in DEMOS:
        shutil.copytree(demo_folder(name), tmp_path / "scenes" / name)
    return tmp_path / "scenes"


def test_a_dataset_is_indexed_searched_and_walked(open_editor, root: Path):
    editor = open_editor(data_root=root)
    editor.pause()
    page = editor.page
    editor.key("n")
    line = page.get_by_role("searchbox", name="Find")
    chip = page.get_by_role("button", name="right-turn", exact=True)
    chip.press("Enter")
    expect(line).to_have_value("right-turn")
    expect(chip).to_be_focused()
    expect(page.get_by_text("5 scenes not indexed yet, so not found.")).to_be_visible()
    editor.press("Index 5 scenes")
    editor.until(lambda: (root / INDEX_NAME).exists(), "an index")
    expect(page.get_by_text("2 of 5 scenarios.")).to_be_visible()
    expect(page.get_by_role("button", name="Index 5 scenes")).to_be_hidden()
    found = editor.workspace.search.found

    # A wrong word is named at the field.
    line.press("End")
    line.press_sequentially(" and densty > 2")
    expect(
        page.get_by_text("'densty' is not known; the nearest is density")
    ).to_be_visible()
    # (It was squeezed into a column of five lines.)
    told = page.locator(".pd-start-told")
    heights = [told.bounding_box()["height"]]
    line.fill("junction = yes")
    expect(told).to_contain_text("'yes' is not known after junction =; expected one of")
    heights.append(told.bounding_box()["height"])
    assert max(heights) < 45
    line.fill('city = miami and "<i>x</i>"')
    expect(page.get_by_text("'\"<i>x</i>\"' is not known")).to_be_visible()
    line.fill("right-turn and density > 0")
    expect(page.get_by_text("is not known")).to_have_count(0)
    rows = page.locator(".pd-start-tile", has_text="right-turn at ")
    expect(rows).to_have_count(len(found))
    editor.screenshot("found_scenes")

    # A click opens the scene at the moment, with its agents.
    def shows(number: int) -> bool:
        folder = sorted(found)[number]
        event, session = found[folder].events[0], editor.session
        axis = session.scenario.time_axis
        return (
            editor.workspace.dataset_folder == folder
            and session.selection == event.agent_ids
            and editor.workspace.playback.step == event.first_step(axis)
        )

    rows.first.click()
    editor.until(lambda: shows(0), "the first moment")
    editor.screenshot("found_moment")
    editor.key("PageDown")
    editor.until(lambda: shows(1), "the next moment")
    editor.key("PageUp")
    editor.until(lambda: shows(0), "the first moment again")

    # The query is there after a reload; a second press of its button takes it away.
    editor.reload()
    editor.key("n")
    expect(line).to_have_value("right-turn and density > 0")
    page.get_by_role("button", name="right-turn", exact=True).click()
    expect(line).to_have_value("density > 0")
    expect(page.locator(".pd-start-tile", has_text="right-turn at ")).to_have_count(0)
