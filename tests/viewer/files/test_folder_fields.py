"""No field of a page reaches folders of the server's machine that it may not name."""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import viser

from pd_editor.base.installed_files import demo_folder
from pd_editor.viewer.state.study_run import StudyRun
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, uuid_of

MARKER = "not-for-visitors"
FOLDER_FIELDS = {"Folder", "Into folder", "Data", "Results folder"}
OTHER_TEXT_FIELDS = {
    "Name",
    "Tags",
    "Note",
    "Moments",
    "Sums of warps",
    "Vary",
    "overlay",
}
"""Texts that name no folder. A new field has to be put into one of the two."""


class Watch:
    """Accesses of this process to files with the marker in their paths."""

    def __init__(self) -> None:
        self.found: list[str] = []
        self.is_on = False

    def __call__(self, event: str, values: tuple[Any, ...]) -> None:
        is_access = event == "open" or event.startswith(("os.", "shutil.", "glob."))
        paths = [str(value) for value in values[:2]]
        if self.is_on and is_access and any(MARKER in path for path in paths):
            self.found.append(f"{event} {paths}")


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    watching = Watch()
    sys.addaudithook(watching)
    for name in ("stat", "lstat", "access"):
        real = getattr(os, name)

        def seen(path: Any, *args: Any, real: Any = real, **options: Any) -> Any:
            watching("os.stat", (path,))
            return real(path, *args, **options)

        monkeypatch.setattr(os, name, seen)
    yield watching
    watching.is_on = False


def texts(tab: FakeTab) -> list[Any]:
    found = [one for group in tab.inputs().values() for one in group]
    return [one for one in found if isinstance(one, viser.GuiTextHandle)]


def press_all(tab: FakeTab) -> None:
    """Press every button, also those of dialogs that open meanwhile."""
    pressed: set[str] = set()
    for _ in range(5):
        for handle in [one for group in tab.inputs().values() for one in group]:
            uuid = uuid_of(handle)
            if isinstance(handle, viser.GuiButtonHandle) and uuid not in pressed:
                pressed.add(uuid)
                tab.enter(handle, True)


def test_every_text_field_is_known(tmp_path: Path):
    with running_app(tmp_path, "crosswalk") as app, connected_tab(app) as tab:
        labels = {str(one.label) for one in texts(tab)}
    assert labels == FOLDER_FIELDS | OTHER_TEXT_FIELDS


@pytest.mark.parametrize("spelling", ["{0}", "demo:{0}"])
def test_no_field_reaches_a_folder_for_visitors(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch, spelling: str
):
    """The study read and wrote any folder, although the other fields were closed."""
    started: list[Any] = []
    monkeypatch.setattr(StudyRun, "start", lambda *args: started.append(args))
    secret = tmp_path / MARKER
    shutil.copytree(demo_folder("roundabout"), secret)
    before = sorted(os.listdir(secret))
    options: dict[str, Any] = {"host": "0.0.0.0", "token": False}
    with (
        running_app(tmp_path / "library", "crosswalk", **options) as app,
        connected_tab(app) as tab,
    ):
        for handle in texts(tab):
            tab.enter(handle, spelling.format(secret))
            assert handle.value in (spelling.format(secret), handle.value)
        watch.is_on = True
        for kind in ("source", "line", "open", "save", "reject"):
            tab.hear("startPage", kind=kind, value=spelling.format(secret))
        press_all(tab)
        # A wrong sum of warps stops a study before its folders are looked at.
        (sums,), (data,) = tab.inputs()["Sums of warps"], tab.inputs()["Data"]
        tab.enter(sums, "")
        press_all(tab)
        assert not started
        # Results of a study of the demos go below the library whatever is typed.
        tab.enter(data, "demos")
        press_all(tab)
        watch.is_on = False
        base = tab.session.base
    assert not [one for one in watch.found if "/library/" not in one]
    assert base.scenario_id != "roundabout"
    assert sorted(os.listdir(secret)) == before
    assert started
    for *_, folder in started:
        assert folder.path.is_relative_to(tmp_path / "library")


def test_the_same_answer_to_what_is_there_and_what_is_not(tmp_path: Path):
    """Else a visitor could find out which folders the machine has."""
    (tmp_path / "there").mkdir()
    options: dict[str, Any] = {"host": "0.0.0.0", "token": False}
    with (
        running_app(tmp_path / "library", "crosswalk", **options) as app,
        connected_tab(app) as tab,
    ):
        told: list[str] = []
        tab.ui.notify = lambda title, body="", *_, **__: told.append(f"{title} {body}")
        for name in ("there", "missing"):
            for handle in texts(tab):
                if handle.label in ("Folder", "Into folder", "Data"):
                    tab.enter(handle, str(tmp_path / name))
            for label in ("Open folder", "Write to folder", "Run the study"):
                (button,) = tab.inputs()[label]
                tab.enter(button, True)
    assert told[:3] == told[3:]
    assert len(told) == 6


def test_this_machine_may_name_any_folder(tmp_path: Path):
    folder = tmp_path / "scenes"
    shutil.copytree(demo_folder("roundabout"), folder)
    with (
        running_app(tmp_path / "library", "crosswalk", host="127.0.0.1") as app,
        connected_tab(app) as tab,
    ):
        (field,), (button,) = tab.inputs()["Folder"], tab.inputs()["Open folder"]
        with mock.patch.object(tab.ui, "notify") as told:
            tab.enter(field, str(tmp_path))
            tab.enter(button, True)
        assert "start the editor with --data" in told.call_args.args[1]
        tab.enter(field, str(folder))
        tab.enter(button, True)
        assert tab.session.base.scenario_id == "roundabout"
        (field,), (button,) = (
            tab.inputs()["Into folder"],
            tab.inputs()["Write to folder"],
        )
        tab.enter(field, str(tmp_path / "out"))
        tab.enter(button, True)
        assert os.listdir(tmp_path / "out")


@pytest.mark.parametrize("text", ["~nosuchuser/x", "x\0y", "x" * 5000])
def test_no_path_that_is_typed_is_a_bug(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch, text: str
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(StudyRun, "start", lambda *_: None)
    with (
        running_app(tmp_path / "library", "crosswalk") as app,
        connected_tab(app) as tab,
    ):
        for handle in texts(tab):
            if handle.label not in ("Data", "Sums of warps", "overlay"):
                tab.enter(handle, text)
        press_all(tab)
        for handle in texts(tab):
            if handle.label == "Data":
                tab.enter(handle, text)
        press_all(tab)
    assert "Traceback" not in caplog.text, caplog.text
    assert not [name for name in os.listdir(tmp_path) if name.startswith("~")]
