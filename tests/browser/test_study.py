"""A perturbation study from the browser, by real mouse."""

from pathlib import Path

import pytest
from playwright.sync_api import expect

from pd_editor.viewer.study_panel import ROADS_AND_FOLDER
from tests.browser.editor_page import EditorPage
from tests.experiments.evaluation.small_dataset import write_dataset

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def small_study(open_editor, tmp_path: Path) -> tuple[EditorPage, Path]:
    """An editor with a study of one kind of warp set up, and its results folder."""
    editor, out = open_editor(), tmp_path / "study"
    editor.open_tab("Study")
    editor.fill("Data", write_dataset(tmp_path / "data"))
    editor.open_folder(ROADS_AND_FOLDER)
    editor.fill("Results folder", out)
    editor.choose("Method", "constant-velocity")
    for kind in ("S-bend (double turn)", "Waves (ripple road)"):
        editor.tick(kind)
    return editor, out


def test_a_study_is_set_up_run_and_its_worst_scene_opened(open_editor, tmp_path: Path):
    data, out = write_dataset(tmp_path / "data"), tmp_path / "study"
    editor = open_editor()
    editor.open_tab("Study")
    # Demos are the scenarios unless a folder is named.
    expect(editor.row("Data").locator("input").first).to_have_value("demos")
    editor.fill("Data", "")
    editor.press("Run the study")
    editor.page.get_by_text("Name the folder of the scenarios").wait_for()
    editor.close_notifications()
    editor.fill("Data", data)
    editor.open_folder(ROADS_AND_FOLDER)
    editor.fill("Results folder", out)
    editor.choose("Method", "lane-follower")
    editor.fill("Sums of warps", "smooth-turn:6+no-such-warp:2")
    editor.press("Run the study")
    editor.page.get_by_text("is not known; expected").wait_for()
    editor.close_notifications()
    editor.fill("Sums of warps", "smooth-turn:6+ripple-road:2")
    editor.press("Run the study")
    editor.page.get_by_text("Done in").wait_for(timeout=300_000)
    assert (out / "report.html").exists()
    panel = editor.tab().elements.study
    chart = editor.page.get_by_role("img", name="SOR, % by power")
    editor.until(lambda: chart.locator("polyline").count() == 2, "two curves")
    points = chart.locator("polyline").first.get_attribute("points") or ""
    assert len(points.split()) == 7
    editor.choose("Warp", "smooth-turn:6+ripple-road:2")
    editor.until(lambda: chart.locator("circle").count() == 4, "the sum's two powers")
    editor.choose("Warp", "ripple-road")
    editor.until(lambda: len(panel._gallery) > 0, "worst scenes")
    editor.screenshot("study")
    with editor.page.expect_download() as download:
        editor.press("Download the report")
    assert download.value.path().read_bytes() == (out / "report.html").read_bytes()
    editor.press("Open scene")
    editor.until(
        lambda: editor.session.base.provenance.base is not None,
        "the worst scene is open",
    )
    # The scene is an export, so its edits can be taken up.
    editor.press("Continue with its 2 edits")
    editor.until(lambda: len(editor.session.entries) == 2, "the edits of the scene")
    # A folder in use is refused, and the settings stay.
    editor.press("Run the study")
    refusal = editor.page.get_by_text("already holds files")
    expect(refusal).to_contain_text("enter a new results folder, or press Resume")
    expect(refusal).not_to_contain_text("--resume")
    editor.screenshot("study_refused")


def test_a_cancelled_study_ends_at_once_and_is_resumed(open_editor, tmp_path: Path):
    editor, out = small_study(open_editor, tmp_path)
    editor.press("Run the study")
    panel = editor.tab().elements.study
    job = editor.until(lambda: panel._study._job, "a job")
    editor.press("Cancel")
    editor.page.get_by_text("Cancelled.").wait_for()
    editor.until(lambda: not job.is_running, "the end of the workers")
    assert not (out / "report.html").exists()
    expect(editor.page.get_by_role("button", name="Run the study")).to_be_enabled()
    editor.choose("Compare with", "random-candidate")
    editor.press("Resume")
    editor.page.get_by_text("with other settings").wait_for()
    editor.close_notifications()
    editor.choose("Compare with", "constant-velocity")
    editor.press("Resume")
    editor.page.get_by_text("Done in").wait_for(timeout=300_000)
    assert (out / "report.html").exists()


def test_a_study_and_its_settings_outlive_a_reload_of_the_page(
    open_editor, tmp_path: Path
):
    """A reload stopped the study without a word, and forgot what it was of."""
    editor, out = small_study(open_editor, tmp_path)
    editor.choose("Compare with", "None")
    editor.press("Run the study")
    study = editor.tab().elements.study._study
    editor.until(lambda: study.is_running, "a study that runs")
    editor.reload()
    editor.open_tab("Study")
    assert editor.tab().elements.study._study is study
    editor.page.get_by_text("Done in").wait_for(timeout=300_000)
    assert (out / "report.html").exists()
    expect(
        editor.page.get_by_role("button", name="Download the report")
    ).to_be_enabled()
    editor.reload()
    editor.open_tab("Study")
    expect(editor.page.get_by_text("Done in")).to_be_visible()
    expect(
        editor.page.get_by_role("button", name="Download the report")
    ).to_be_enabled()
    # The same settings are there, so the folder is that of this study.
    editor.press("Run the study")
    expect(editor.page.get_by_text("already holds files")).to_contain_text(str(out))
