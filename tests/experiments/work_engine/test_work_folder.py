from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from pd_editor.base.errors import ExportError, InputError
from pd_editor.experiments.work_engine.work_folder import ResumableFolder

SETTINGS = {"version": "1", "data": ("/data",), "seed": 0}


def opened(path: Path, settings: Mapping[str, Any] = SETTINGS, *, resume: bool):
    return ResumableFolder(path, settings, work="evaluation", resume=resume)


def test_files_are_there_when_work_goes_on(tmp_path):
    folder = opened(tmp_path / "deep" / "out", resume=False)
    written = folder.write("finished/a/one.json", b"1")
    folder.write("finished/a/one.json", b"2")
    again = opened(tmp_path / "deep" / "out", resume=True)
    assert (again.path / "finished" / "a" / "one.json") == written
    assert written.read_bytes() == b"2"
    assert [path.name for path in written.parent.iterdir()] == ["one.json"]


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    folder = opened(tmp_path / "out", resume=False)
    (folder.path / "taken").mkdir()
    with pytest.raises(ExportError, match="taken: cannot be written"):
        folder.write("taken", b"")


@pytest.mark.parametrize(
    "change", [{"seed": 1}, {"data": ("/other",)}, {"version": "2"}]
)
def test_other_settings_are_refused(tmp_path, change):
    opened(tmp_path, resume=False)
    with pytest.raises(InputError, match=next(iter(change))):
        opened(tmp_path, SETTINGS | change, resume=True)


def test_a_run_that_finished_nothing_leaves_its_folder_free(tmp_path):
    """One that was refused after its start had to be told another folder."""
    opened(tmp_path, resume=False)
    opened(tmp_path, SETTINGS | {"seed": 1}, resume=False).write("finished/a", b"1")
    with pytest.raises(ExportError, match="already holds files"):
        opened(tmp_path, resume=False)


def test_places_that_cannot_be_used(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / "a\0b"):
        with pytest.raises(ExportError, match="cannot be written"):
            opened(place, resume=False)
    with pytest.raises(ExportError, match="already holds files"):
        opened(tmp_path, resume=False)
    with pytest.raises(ExportError, match="no evaluation"):
        opened(tmp_path, resume=True)
    (tmp_path / "settings.json").write_text("[1]")
    with pytest.raises(InputError):
        opened(tmp_path, resume=True)
