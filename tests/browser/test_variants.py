"""Exports with names, the library, and exports that are opened again."""

import csv
import io
import json
import zipfile

import pytest

from pd_editor.editor.commands import SetAgentSpeed, SetRoadWarp
from pd_editor.scene.av2_io.write import check_with_official_loaders
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.files.export_panel import OTHER_WAYS

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def bend(editor, power: float = 6.0) -> None:
    session = editor.session
    anchor = pose_of_anchor(session.scenario, "focal")
    term = WarpTerm(kind="double-turn", power=power, length_m=10.0)
    command = SetRoadWarp(
        warp=RoadWarp(anchor=anchor, terms=(term,)), friction_coefficient=None
    )
    count = session.state.position
    editor.tab().ui.post(lambda: session.apply(command))
    editor.until(lambda: session.state.position == count + 1, "a bend")


def slow_down(editor, speed_mps: float) -> None:
    session = editor.session
    command = SetAgentSpeed(agent_ids=(session.scenario.focal_id,), speed_mps=speed_mps)
    count = session.state.position
    editor.tab().ui.post(lambda: session.apply(command))
    editor.until(lambda: session.state.position == count + 1, "an edit")


def notice(editor, text: str) -> None:
    editor.page.get_by_text(text).first.wait_for()


def value(editor, label: str) -> str:
    return editor.row(label).locator("input:not([type=hidden])").first.input_value()


def downloaded(editor, button: str) -> tuple[str, zipfile.ZipFile]:
    with editor.page.expect_download() as download:
        editor.press(button)
    path = download.value.path()
    return download.value.suggested_filename, zipfile.ZipFile(path)


def test_starred_states_are_downloaded_as_one_zip_with_a_table(open_editor):
    """(D6): names are proposed, the library survives a reload, S stars."""
    editor = open_editor()
    notice(editor, "no new problems")
    bend(editor)
    editor.until(
        lambda: value(editor, "Name") == "signalised-junction-double-turn-p6", "a name"
    )
    editor.key("s")
    notice(editor, "Saved to library: signalised-junction-double-turn-p6")
    slow_down(editor, 3.0)
    editor.fill("Name", "My slow one!")
    editor.fill("Tags", "slow, bent")
    editor.fill("Note", "a note")
    editor.until(lambda: editor.session.variant.note, "a note")
    editor.press("Save to library")
    notice(editor, "Saved to library: My-slow-one")
    editor.press("Save to library")
    notice(editor, "in the library already")
    editor.screenshot("41_library")
    editor.key("n")
    editor.page.get_by_role("tab", name="Library 2").click()
    name, archive = downloaded(editor, "Download 2")
    assert name == "scenarios.zip"
    rows = list(csv.DictReader(io.StringIO(archive.read("index.csv").decode())))
    assert [row["id"] for row in rows] == [
        "signalised-junction-double-turn-p6",
        "My-slow-one",
    ]
    assert rows[1]["tags"] == "slow; bent"
    assert {row["base_id"] for row in rows} == {"signalised-junction"}
    for row in rows:
        one = row["id"]
        recipe = json.loads(archive.read(f"{one}/recipe.json"))
        assert recipe["variant"]["name"] == one
        assert f"{one}/scenario_{one}.parquet" in archive.namelist()
    editor.reload()
    tile = editor.page.get_by_role("listitem").filter(has_text="My-slow-one")
    image = tile.locator("img")
    editor.until(lambda: image.get_attribute("src"), "a picture")
    stands = "begin%3D%22indefinite"
    editor.page.get_by_role("searchbox", name="Find").click()
    editor.until(lambda: stands in image.get_attribute("src"), "a picture at rest")
    tile.hover()
    editor.until(lambda: stands not in image.get_attribute("src"), "a moving one")
    tile.get_by_role("button", name="Tick").click()
    ticked = editor.page.get_by_role("button", name="Download 1", exact=True)
    ticked.wait_for()
    # (It opened the scenario.)
    for state in ("hidden", "visible"):
        tile.locator(".pd-start-tile").click(modifiers=["Control"])
        ticked.wait_for(state=state)
    editor.press("Remove 1")
    editor.until(
        lambda: (
            [one.name for one in editor.workspace.library.cards()] == [rows[0]["id"]]
        ),
        "an entry less",
    )


def _label(row: dict[str, str]) -> str:
    count = int(row["num_problems"])
    problems = [f"{count} problem{'s' * (count != 1)}"] if count else []
    title = " · ".join([row["id"], *problems, *row["tags"].split("; ")])
    return f"{title} {row['note']}".strip()


def test_an_export_is_never_replaced_silently_and_opens_again(open_editor, tmp_path):
    """(D5, D6): the second went over the first; a reopened one forgot what it is."""
    editor = open_editor()
    out = tmp_path / "out"
    editor.open_folder(OTHER_WAYS)
    editor.fill("Into folder", out)
    bend(editor)
    slow_down(editor, 3.0)
    editor.press("Write to folder")
    name = "signalised-junction-double-turn-p6-2-edits"
    editor.until(lambda: (out / name).is_dir(), "an export")
    check_with_official_loaders(out / name)
    first = {path.name: path.read_bytes() for path in (out / name).iterdir()}
    slow_down(editor, 5.0)
    editor.until(lambda: value(editor, "Name").endswith("3-edits"), "a name")
    editor.fill("Name", name)
    editor.until(lambda: editor.session.variant.name == name, "the name")
    editor.press("Write to folder")
    notice(editor, "There is an export of this name")
    editor.screenshot("42_taken")
    # Escape, or a press beside the dialog, changes nothing.
    dialog = editor.page.get_by_text("There is an export of this name")
    editor.page.keyboard.press("Escape")
    dialog.wait_for(state="detached")
    editor.press("Write to folder")
    dialog.wait_for()
    editor.page.mouse.click(20, 400)
    dialog.wait_for(state="detached")
    assert [path.name for path in out.iterdir()] == [name]
    editor.fill("Name", "///")
    editor.press("Write to folder")
    notice(editor, "has no letter or digit; type another name")
    editor.fill("Name", name)
    editor.until(lambda: editor.session.variant.name == name, "the name")
    editor.close_notifications()
    editor.press("Write to folder")
    dialog.wait_for()
    editor.press(f"Write as {name}-2")
    editor.until(lambda: (out / f"{name}-2").is_dir(), "another export")
    assert {path.name: path.read_bytes() for path in (out / name).iterdir()} == first
    # The field tells what was written, and takes the other name back.
    editor.until(lambda: value(editor, "Name") == f"{name}-2", "the name that was free")
    editor.fill("Name", name)
    editor.until(lambda: value(editor, "Name") == name, "the name")
    editor.press("Write to folder")
    editor.page.get_by_role("button", name="Replace the export of").click()
    notice(editor, "Replaced the earlier export")
    assert {path.name: path.read_bytes() for path in (out / name).iterdir()} != first

    editor.open_folder("From a folder")
    editor.fill("Folder", out / f"{name}-2")
    editor.press("Open folder")
    notice(editor, "This is an export of the editor")
    editor.screenshot("43_continue")
    editor.press("Open as it is")
    assert editor.session.base.provenance.is_bent
    notice(editor, "Exported from signalised-junction with these edits")
    editor.open_tab("Road")
    notice(editor, "This scenario was exported bent")
    reference = editor.session.recipe().base
    assert reference.root.scenario_id == "signalised-junction"
    editor.open_tab("Scene")
    editor.choose_scene("Demos", "roundabout")
    editor.until(lambda: editor.session.scenario.scenario_id == "roundabout", "a demo")
    editor.press("Open folder")
    editor.press("Continue with its 3 edits")
    editor.until(lambda: len(editor.session.entries) == 3, "its history")
    assert editor.session.base.scenario_id == "signalised-junction"
    assert editor.page.get_by_text("The result differs").count() == 0
