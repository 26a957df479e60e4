"""``pd-editor index`` and ``find``."""

import json
import os
import shutil
from contextlib import nullcontext
from pathlib import Path

import pytest

import pd_editor
from pd_editor.base.installed_files import demo_folder
from pd_editor.experiments.scene_index import index_file
from pd_editor.experiments.scene_index.index_file import INDEX_NAME
from pd_editor.experiments.work_engine.work_engine import result_of
from tests.cli.shell import Shell

pytestmark = pytest.mark.usefixtures("no_processes")

DEMOS = ("crosswalk", "roundabout")


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    root = tmp_path / "scenes"
    for name in DEMOS:
        shutil.copytree(demo_folder(name), root / name)
    return root


def test_scenes_are_read_once_and_found(shell: Shell, scenes: Path):
    result = shell.run("index", scenes, "--workers", 1)
    assert result.code == 0, result.err
    assert result.lines == [
        str(scenes / INDEX_NAME),
        "2 scenes, 2 of them read now.",
    ]
    assert shell.run("index", scenes).lines[1] == "2 scenes, 0 of them read now."
    track = next((scenes / "crosswalk").glob("*.parquet"))
    os.utime(track, ns=(1, 1))
    assert shell.run("index", scenes).lines[1] == "2 scenes, 1 of them read now."
    shutil.rmtree(scenes / "crosswalk")
    assert shell.run("index", scenes).lines[1] == "1 scene, 0 of them read now."
    found = shell.run("find", scenes, "junction = roundabout and not agents < 1")
    assert found.lines == [str(scenes / "roundabout"), "1 scene."]


def test_the_answer_is_json_or_values(shell: Shell, scenes: Path):
    shell.run("index", scenes)
    result = shell.run("find", scenes, "stands or parked or following", "--json")
    told = json.loads(result.out)
    found = pd_editor.find(scenes, "stands or parked or following").scenes
    assert [one["scenario_id"] for one in told] == [one.scenario_id for one in found]
    assert told[0]["facts"]["agents"] == found[0].facts["agents"]
    assert told[0]["events"][0]["kind"] == found[0].events[0].kind


def test_a_broken_scene_does_not_stop_the_others(shell: Shell, scenes: Path):
    next((scenes / "crosswalk").glob("*.parquet")).write_bytes(b"PAR1 nonsense")
    result = shell.run("index", scenes, "--workers", 1)
    assert result.code == 2
    assert "1 scene, 1 of them read now." in result.out
    assert "crosswalk" in result.err
    assert "Traceback" not in result.err


def test_an_interrupted_run_keeps_what_it_read(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(
        "pd_editor.cli.many_scenes.EngineChoice.engine", interrupted_after_one
    )
    with pytest.raises(KeyboardInterrupt):
        pd_editor.index(scenes)
    monkeypatch.undo()
    assert pd_editor.index(scenes).num_read == 1


def interrupted_after_one(choice):
    class OneItem:
        def run(self, function, items, *, on_result, on_wait):
            key = next(iter(items))
            on_result(result_of(function, key, items[key]))
            raise KeyboardInterrupt

    return nullcontext(OneItem())


def test_a_failed_write_leaves_the_earlier_index(
    shell: Shell, scenes: Path, monkeypatch: pytest.MonkeyPatch
):
    shell.run("index", scenes)
    before = (scenes / INDEX_NAME).read_bytes()
    next((scenes / "crosswalk").glob("*.parquet")).touch()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert "No space" in shell.run("index", scenes).err
    assert (scenes / INDEX_NAME).read_bytes() == before


def test_what_is_no_index_is_refused(shell: Shell, scenes: Path, tmp_path: Path):
    assert "holds no index" in shell.refused("find", scenes, "cut-in")
    assert "no such file or folder" in shell.refused("find", scenes / "x", "cut-in")
    track = next((scenes / "crosswalk").glob("*.parquet"))
    assert "no index of this version" in shell.refused("find", track, "cut-in")
    (tmp_path / INDEX_NAME).write_bytes(b"nothing")
    assert "no index that can be read" in shell.refused("find", tmp_path, "cut-in")
    assert "--out" in shell.refused("index", scenes, "roundabout")
    told = shell.refused("index", tmp_path / "gone")
    assert "gone: there is no such file or folder" in told


def test_other_rules_read_all_again(scenes: Path, monkeypatch: pytest.MonkeyPatch):
    pd_editor.index(scenes, workers=1)
    monkeypatch.setattr(index_file, "RULES", "changed")
    assert pd_editor.index(scenes, workers=1).num_read == 2
