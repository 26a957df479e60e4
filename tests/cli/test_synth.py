import json
import shutil
from pathlib import Path

import pytest

import pd_editor
from pd_editor.experiments.recordings.shards import ShardReader
from pd_editor.experiments.synthesis import dataset_builder as corpus_networks
from tests.cli.shell import Shell, run_in_process
from tests.experiments.recordings.recordings import drive

GRID = ("--families", "grid", "--workers", 1)


@pytest.fixture
def drives(monkeypatch: pytest.MonkeyPatch, no_processes: None) -> None:
    """No SUMO: traffic made by hand."""
    monkeypatch.setattr(
        corpus_networks,
        "_recording",
        lambda item: drive(seed=item.seed, name=item.key),
    )


@pytest.mark.slow
def test_the_command_makes_scenarios(tmp_path: Path):
    """With SUMO, in processes, once."""
    out = tmp_path / "out"
    result = run_in_process(
        "synth", "--out", str(out), "--num", "2", "--families", "grid", "--workers", "1"
    )
    assert result.code == 0, result.err
    assert result.lines[0] == str(out / "manifest.json")
    assert result.lines[1].startswith("2 windows on 1 networks with ")
    assert len(list(out.glob("*/scenario_*.parquet"))) == 2


def test_it_is_a_python_function_too(drives: None, tmp_path: Path):
    made = pd_editor.synth(
        out=tmp_path / "out", num=90, seed=3, families=("grid", "town"), shards=True
    )
    assert made.record.num_windows == 90
    assert len(ShardReader(made.folder)) == 90
    manifest = json.loads(made.files[0].read_text())
    assert (manifest["seed"], manifest["form"]) == (3, "shards")


def test_a_run_goes_on(shell: Shell, drives: None, tmp_path: Path):
    out = tmp_path / "out"
    command = ("synth", "--out", out, "--num", 3, *GRID, "--shards")
    assert shell.run(*command).code == 0
    assert "already holds files" in shell.refused(*command)
    assert "(seed)" in shell.refused(*command, "--resume", "--seed", 1)
    assert shell.run(*command, "--resume").code == 0


def test_bad_wishes_are_refused(shell: Shell, drives: None, tmp_path: Path):
    command = ("synth", "--out", tmp_path / "out", "--num")
    assert "no family of roads 'moon'" in shell.refused(
        *command, 3, "--families", "moon"
    )
    assert "--num is 0" in shell.refused(*command, 0)
    assert "--workers is 0" in shell.refused(*command, 3, "--workers", 0)
    assert "--noise or --shards" in shell.refused(*command, 3, "--noise", "--shards")
    assert "one folder of real scenes, or two" in shell.refused(
        *command, 3, "--report", "a", "b", "c"
    )
    assert "no Argoverse 2 scenario" in shell.refused(*command, 3, "--maps", tmp_path)
    report = ("--report", tmp_path)
    assert "no Argoverse 2 scenario" in shell.refused(*command, 3, *report)
    assert not (tmp_path / "out").exists() or not list(tmp_path.glob("out/*.shard"))
    taken = tmp_path / "file"
    taken.write_text("mine")
    assert "cannot be written" in shell.refused("synth", "--out", taken, "--num", 3)


def test_without_sumo_it_says_what_to_install(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    said = shell.refused("synth", "--out", tmp_path / "out", "--num", 3)
    assert "pip install 'pd-editor[synth]'" in said


@pytest.mark.slow
@pytest.mark.real_data
def test_a_report_compares_with_real_scenes(
    shell: Shell, drives: None, av2_scenario_folders: list[Path], tmp_path: Path
):
    real = tmp_path / "real"
    folders = [one for one in av2_scenario_folders if one.parent.name == "train"]
    for folder in folders[:3]:
        shutil.copytree(folder, real / folder.name)
    out = tmp_path
    command = ("synth", "--num", 4, *GRID, "--report", real)
    for form in ("--shards", "--noise"):
        result = shell.run(*command, "--out", out / form[2:], form)
        assert result.code == 0
        assert "3 real ones" in (out / form[2:] / "realism.md").read_text()
        assert json.loads((out / form[2:] / "realism.json").read_text())["rows"]
