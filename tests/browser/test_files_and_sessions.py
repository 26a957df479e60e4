"""Opening, bad input, reloads, several tabs, and work that outlives a kill."""

import os
import re
import signal
import subprocess
import sys
import threading

import pytest
from playwright.sync_api import expect

from pd_editor.editor.commands import SetAgentSpeed
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files, zip_folders
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import open_tabs

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def folder(tmp_path):
    out = tmp_path / "made"
    write_files(scenario_files(two_agents_that_pass()), out, forbidden=None)
    return out


def upload(editor, name: str, content: bytes) -> None:
    editor.page.locator("input[type=file]").first.set_input_files(
        {"name": name, "mimeType": "application/octet-stream", "buffer": content}
    )


def notice(editor, text: str) -> None:
    editor.page.get_by_text(text).first.wait_for()


def test_open_a_folder_by_path_and_upload_a_zip(open_editor, folder):
    editor = open_editor()
    editor.open_folder("From a folder")
    editor.fill("Folder", folder)
    editor.press("Open folder")
    editor.until(
        lambda: editor.session.scenario.scenario_id == "two-lane-road", "the folder"
    )
    editor.choose_scene("Demos", "Lights turn green for a full")
    editor.until(
        lambda: editor.session.scenario.scenario_id != "two-lane-road", "the demo"
    )
    upload(
        editor, "any.zip", zip_folders({"x": scenario_files(two_agents_that_pass())})
    )
    editor.until(
        lambda: editor.session.scenario.scenario_id == "two-lane-road", "the upload"
    )


def test_parquet_then_map(open_editor):
    editor = open_editor()
    files = scenario_files(two_agents_that_pass())
    parquet, road = sorted(files, reverse=True)
    upload(editor, parquet, files[parquet])
    notice(editor, "Now upload the map JSON")
    upload(editor, road, files[road])
    editor.until(
        lambda: editor.session.scenario.scenario_id == "two-lane-road", "both files"
    )


@pytest.mark.parametrize(
    ("name", "content"),
    [("broken.zip", b"PK\x03\x04 not really"), ("nothing.zip", b"")],
)
def test_a_bad_upload_says_so_and_changes_nothing(open_editor, name, content):
    editor = open_editor()
    opened = editor.session.scenario
    upload(editor, name, content)
    notice(editor, f"Not opened: {name}")
    # viser's own notice would say the contrary beside it.
    editor.page.wait_for_timeout(300)
    expect(editor.page.get_by_text("File uploaded successfully")).to_be_hidden()
    assert editor.session.scenario is opened


def test_a_missing_folder_says_so_and_names_are_shown_as_text(open_editor):
    editor = open_editor()
    opened = editor.session.scenario
    editor.open_folder("From a folder")
    editor.fill("Folder", "/nowhere/<img src=x onerror=alert(1)>")
    editor.press("Open folder")
    notice(editor, "<img src=x onerror=alert(1)>")
    assert editor.page.locator("img[src=x]").count() == 0
    assert editor.session.scenario is opened


def test_a_reload_waits_for_the_end_of_what_the_former_page_does(open_editor):
    editor = open_editor()
    session, goes_on = editor.session, threading.Event()
    editor.tab().ui.post(lambda: goes_on.wait(20))
    threading.Timer(3.0, goes_on.set).start()
    editor.reload()
    assert goes_on.is_set()
    assert editor.session is session


def test_a_reload_finds_its_session_and_a_second_tab_gets_its_own(open_editor):
    editor = open_editor()
    focal = editor.session.scenario.focal_id
    session = editor.session
    editor.workspace.playback.pause()
    editor.tab().ui.post(
        lambda: session.apply(SetAgentSpeed(agent_ids=(focal,), speed_mps=3.0))
    )
    editor.until(lambda: len(session.entries) == 1, "an edit")
    second = open_editor(app=editor.app, context=editor.page.context)
    assert second.session is not session
    assert not second.session.entries
    editor.reload()
    assert editor.session is session
    assert len(editor.session.entries) == 1
    # Once the second tab is closed its session is free, but it is not the first tab's.
    second.page.close()
    editor.until(lambda: len(open_tabs(editor.app)) == 1, "the end of the second tab")
    editor.reload()
    assert editor.session is session


def test_a_raising_callback_is_shown_and_the_editor_lives(open_editor, caplog):
    editor = open_editor()
    editor.tab().ui.post(lambda: 1 / 0)
    notice(editor, "A bug in the editor")
    assert "ZeroDivisionError" in caplog.text
    editor.pause()
    editor.until(lambda: not editor.workspace.playback.is_playing, "a pause")


def test_a_killed_server_offers_its_work_back(open_editor, tmp_path):
    state = tmp_path / "state"
    code = (
        "import sys, time; from pathlib import Path;"
        "from pd_editor.editor.scenario_store import open_scenario;"
        "from pd_editor.viewer.state.session_shelf import SessionShelf;"
        "from pd_editor.viewer.state.workspace import Workspace;"
        "from pd_editor.editor.commands import SetAgentSpeed;"
        "scene = open_scenario('signalised-junction');"
        "work = Workspace(scene, dataset=None, shelf=SessionShelf(Path(sys.argv[1])));"
        "ids = (scene.focal_id,);"
        "[work.session.apply(SetAgentSpeed(agent_ids=ids, speed_mps=s)) for s in (3., 4.)];"
        "work.session.undo(); print('ready', flush=True); time.sleep(60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(state)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "ready"
    os.kill(process.pid, signal.SIGKILL)
    process.wait(10)
    process.stdout.close()

    editor = open_editor(state=state)
    notice(editor, "Unfinished work found")
    # The notice stays until the list is opened.
    editor.key("n")
    tab = editor.page.get_by_role("tab", name="Unfinished 1")
    expect(tab).to_be_visible()
    expect(editor.page.get_by_text("Unfinished work found")).to_have_count(0)
    editor.key("Escape")
    editor.reload()
    editor.settle()
    # It was said again at each reload.
    assert not editor.page.get_by_text("Unfinished work found").count()
    editor.choose_scene("Unfinished", "1 edit, last ")
    editor.until(lambda: len(editor.session.entries) == 2, "the work")
    assert editor.session.state.position == 1
    editor.key("Control+y")
    editor.until(lambda: editor.session.state.position == 2, "the undone edit redone")


def test_another_scenario_keeps_the_edits_and_coming_back_resumes_them(open_editor):
    """(D3): Page Down threw them away without a word."""
    editor = open_editor()
    session = editor.session
    focal, other = session.scenario.agents.ids[:2]
    editor.tab().ui.post(
        lambda: (
            [
                session.apply(SetAgentSpeed(agent_ids=(focal,), speed_mps=speed))
                for speed in (3.0, 4.0)
            ]
            and session.select((other,))
        )
    )
    editor.until(lambda: session.selection == (other,), "edits")
    edited = session.scenario
    editor.choose_scene("Demos", "roundabout")
    editor.until(lambda: session.scenario.scenario_id == "roundabout", "another demo")
    notice(editor, "2 edits of signalised-junction are kept")
    assert not session.entries
    editor.key("n")
    editor.page.get_by_role("tab", name="Unfinished 1").click()
    notice(editor, "2 edits, last")
    editor.screenshot("40_unfinished")
    editor.choose_scene("Demos", "signalised-junction")
    editor.until(lambda: session.scenario is edited, "the edits")
    notice(editor, "Back to signalised-junction")
    assert len(session.entries) == 2
    assert session.selection == (other,)
    editor.key("Control+z")
    editor.until(lambda: session.state.position == 1, "an undo")


def test_unfinished_work_is_discarded_when_asked_twice(open_editor):
    """(D3): it is listed at any time, not only after a restart."""
    editor = open_editor()
    session = editor.session
    focal = session.scenario.focal_id
    editor.tab().ui.post(
        lambda: session.apply(SetAgentSpeed(agent_ids=(focal,), speed_mps=3.0))
    )
    editor.until(lambda: session.entries, "an edit")
    editor.choose_scene("Demos", "roundabout")
    editor.until(lambda: session.scenario.scenario_id == "roundabout", "another demo")
    editor.key("n")
    editor.page.get_by_role("tab", name="Unfinished 1").click()
    editor.page.locator(".pd-start-box", has_text="1 edit, last").hover()
    discard = editor.page.get_by_role("button", name=re.compile("^Discard"))
    discard.click()
    notice(editor, "X again discards it for good")
    assert len(editor.workspace.shelf.unfinished()) == 1
    discard.click()
    notice(editor, "Nothing found.")
    assert editor.workspace.shelf.unfinished() == []


def test_a_library_is_opened_again_as_a_list(open_editor, tmp_path):
    """A zip with several scenarios was refused, the editor's own included."""
    editor = open_editor()
    session, workspace = editor.session, editor.workspace

    def star_two() -> None:
        for speed in (3.0, 4.0):
            ids = (session.scenario.focal_id,)
            session.apply(SetAgentSpeed(agent_ids=ids, speed_mps=speed))
            workspace.save()

    editor.tab().ui.post(star_two)
    editor.until(lambda: len(workspace.library.cards()) == 2, "two stars")
    first, second = (entry.name for entry in workspace.library.cards())
    upload = tmp_path / "library.zip"
    upload.write_bytes(workspace.library.zipped((first, second)))
    with editor.page.expect_file_chooser() as chooser:
        editor.press("Upload files")
    chooser.value.set_files(upload)
    page = editor.page
    expect(page.get_by_role("tab", name="Zip 2")).to_have_attribute(
        "aria-selected", "true"
    )
    tile = page.locator(".pd-start-tile.pd-start-drawn")
    expect(tile).to_have_count(2)
    editor.screenshot("41_zip")
    tile.filter(has_text=second).click()
    editor.until(lambda: session.base.scenario_id == second, "the second one")
    editor.press("Continue with its 2 edits")
    editor.until(lambda: session.state.position == 2, "its edits")
    editor.until(lambda: workspace.is_exported, "what the zip holds")
    editor.key("n")
    tile.filter(has=page.get_by_text(first, exact=True)).click()
    editor.until(lambda: session.base.scenario_id == first, "the first one")
