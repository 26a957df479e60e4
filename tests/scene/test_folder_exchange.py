"""A reader sees an export's old or new state whole (Reliability 11)."""

import os
import threading
from pathlib import Path

import pytest

from pd_editor.scene import bundle
from pd_editor.scene.bundle import exchange, write_files
from pd_editor.scene.formats.dataset import DatasetIndex


def files(number: int) -> dict[str, bytes]:
    return dict.fromkeys(("a", "b", "recipe.json"), b"%d" % number * 1000)


def test_folders_are_swapped(tmp_path: Path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    if not exchange(tmp_path / "one", tmp_path / "other"):
        pytest.skip("this system cannot swap folders")
    assert os.listdir(tmp_path / "one") == ["other"]
    assert os.listdir(tmp_path / "other") == ["one"]
    assert not exchange(tmp_path / "one", tmp_path / "gone")


def test_a_reader_always_finds_a_whole_folder(tmp_path: Path):
    target = tmp_path / "out"
    write_files(files(0), target, forbidden=None)
    (tmp_path / "probe").mkdir()
    if not exchange(target, tmp_path / "probe"):
        pytest.skip("this system cannot swap folders")
    exchange(target, tmp_path / "probe")
    seen: list[set[bytes]] = []
    missing: list[int] = []
    ends = threading.Event()

    def read() -> None:
        while not ends.is_set():
            # A handle stays with the folder that it was opened on.
            handle = os.open(target, os.O_RDONLY)
            try:
                contents = set()
                for name in files(0):
                    number = os.open(name, os.O_RDONLY, dir_fd=handle)
                    with os.fdopen(number, "rb") as file:
                        contents.add(file.read())
                seen.append(contents)
            except FileNotFoundError:
                # The old folder was removed while it was read; the path is there.
                missing.append(1)
                assert (target / "a").exists()
            finally:
                os.close(handle)

    reader = threading.Thread(target=read)
    reader.start()
    for number in range(1, 30):
        write_files(files(number), target, forbidden=None, overwrite=True)
    ends.set()
    reader.join()
    assert seen
    assert all(len(contents) == 1 for contents in seen)
    assert sorted(os.listdir(tmp_path)) == ["out", "probe"]


def test_systems_that_cannot_swap_rename(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(bundle, "exchange", lambda *_: False)
    for number in (0, 1):
        write_files(files(number), tmp_path / "out", forbidden=None, overwrite=True)
    assert (tmp_path / "out" / "a").read_bytes() == files(1)["a"]
    assert os.listdir(tmp_path) == ["out"]


def test_left_overs_of_a_kill_are_hidden_and_cleared(tmp_path: Path):
    for name, age in ((".out.00000000.new", 1e4), (".out.11111111.new", 0.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scenario_x.parquet").touch()
        (tmp_path / name / "log_map_archive_x.json").touch()
        stamp = (tmp_path / name).stat().st_mtime - age
        os.utime(tmp_path / name, (stamp, stamp))
    dataset = DatasetIndex(tmp_path)
    dataset.scan()
    assert dataset.folders() == ()
    write_files(files(0), tmp_path / "out", forbidden=None)
    assert sorted(os.listdir(tmp_path)) == [".out.11111111.new", "out"]


def test_an_old_state_comes_back_where_a_kill_left_none(tmp_path: Path):
    (tmp_path / ".out.00000000.old").mkdir()
    (tmp_path / ".out.00000000.old" / "recipe.json").touch()
    write_files(files(3), tmp_path / "out", forbidden=None, overwrite=True)
    assert os.listdir(tmp_path) == ["out"]
