import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import pd_editor
from pd_editor.cli import evaluate as evaluate_module
from pd_editor.experiments.work_engine.work_engine import WorkProgress, progress_line
from tests.builders import scenario_with, straight_drivers
from tests.cli.shell import ROOT, Result, Shell
from tests.experiments.evaluation.small_dataset import (
    COLLIDING,
    make_sideways,
    without_future,
    write_dataset,
    write_scenario,
)

pytestmark = pytest.mark.usefixtures("no_processes")

FILES = ["report.html", "report.md", "rows.parquet"]


def check_done(result: Result) -> None:
    """A run that ended well; what is slow, as on a busy machine, tells its progress."""
    assert result.code == 0, result.err
    assert all("scenes on roads" in line for line in result.err.splitlines())


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "data")


@pytest.fixture
def sideways(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("raises", "raises-on-bbb", "sideways")
    monkeypatch.setattr(evaluate_module, "GENERATORS", dict.fromkeys(names))
    monkeypatch.setattr(evaluate_module, "make_generator", make_sideways)


def test_a_run_writes_rows_and_reports(shell: Shell, data: Path, tmp_path: Path):
    out = tmp_path / "out"
    options = ("--warps", "none", "ripple-road:6", "--samples", 2, "--workers", 1)
    result = shell.run("evaluate", "--data", data, "--out", out, *options)
    check_done(result)
    assert sorted(result.lines) == [str(out / name) for name in FILES]
    rows = pq.read_table(out / "rows.parquet")
    methods = set(rows["method"].to_pylist())
    assert methods == set(evaluate_module.DEFAULT_METHODS)
    assert set(rows["warp"].to_pylist()) == {"none", "ripple-road"}
    text = (out / "report.md").read_text()
    assert "ORACLE" in text
    assert f"--data {data} --out {out}" in text
    assert "--warps none ripple-road:6 --samples 2 --seed 0" in text


@pytest.mark.slow
def test_states_can_be_drawn_too(shell: Shell, data: Path, tmp_path: Path):
    out = tmp_path / "out"
    options = ("--states", "sampled", "--samples", 1, "--limit", 1, "--workers", 1)
    result = shell.run("evaluate", "--data", data, "--out", out, *options)
    check_done(result)
    rows = pq.read_table(out / "rows.parquet")
    assert rows["method"].to_pylist() == ["ground-truth"] * 2 + ["path-diffuser"] * 2
    text = (out / "report.md").read_text()
    for words in (
        "Initial states and trajectories are sampled: as many",
        "| method | agents / scenes | collision 2 m, % | boxes overlap, % |",
        "--states sampled --agents all",
        "2 agents of the log at the current step",
    ):
        assert words in text
    assert "Differences to the log" not in text
    assert "ADE, m" not in text


@pytest.mark.parametrize("name", ["lane-follower", "best-candidate"])
def test_who_draws_no_states_is_refused_where_they_are_drawn(
    shell: Shell, data: Path, tmp_path: Path, name: str
):
    command = ("evaluate", "--data", data, "--out", tmp_path / "out")
    words = shell.refused(*command, "--states", "sampled", "--methods", name)
    assert words.startswith(f"{name} samples no initial states")
    assert not (tmp_path / "out").exists()


def test_it_is_a_python_function_too(data: Path, tmp_path: Path):
    found = pd_editor.evaluate(
        data=data / "train",
        out=tmp_path / "out",
        methods=("constant-velocity",),
        limit=1,
        workers=1,
    )
    assert [path.name for path in found.files] == [
        "report.md",
        "report.html",
        "rows.parquet",
    ]
    assert found.record.num_scenes == 1
    collided = found.summary.statistics["new_overlap"].mean.value[0, 0, 0]
    assert collided == 1.0
    assert str(found).splitlines() == list(map(str, found.files))


@pytest.mark.slow
def test_the_kept_files_let_it_go_on(shell: Shell, data: Path, tmp_path: Path):
    out = tmp_path / "out"
    command = ("evaluate", "--data", data, "--out", out, "--workers", 1)
    assert shell.run(*command, "--limit", 1).code == 0
    assert "already holds files" in shell.refused(*command)
    assert "samples" in shell.refused(*command, "--resume", "--samples", 2)
    assert shell.run(*command, "--resume").code == 0
    whole = (out / "rows.parquet").read_bytes()
    assert shell.run(*command, "--resume").code == 0
    assert (out / "rows.parquet").read_bytes() == whole


@pytest.mark.slow
def test_a_killed_process_goes_on_to_the_same_numbers(data: Path, tmp_path: Path):
    def command(out: str) -> list[str]:
        words = (
            f"evaluate --data {data} --out {tmp_path / out} --warps none ripple-road:3"
        )
        return [sys.executable, "-m", "pd_editor", *words.split(), "--workers", "1"]

    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    killed = subprocess.Popen(
        command("killed"), env=environment, start_new_session=True
    )
    finished = tmp_path / "killed" / "finished"
    deadline = time.monotonic() + 120
    while len(list(finished.rglob("*.parquet"))) < 3:
        assert time.monotonic() < deadline
        assert killed.poll() is None
        time.sleep(0.02)
    os.killpg(killed.pid, signal.SIGKILL)
    assert killed.wait() == -signal.SIGKILL
    assert not (tmp_path / "killed" / "rows.parquet").exists()
    for words in ([*command("killed"), "--resume"], command("whole")):
        subprocess.run(words, env=environment, check=True, capture_output=True)
    one, other = (tmp_path / out / "rows.parquet" for out in ("killed", "whole"))
    assert one.read_bytes() == other.read_bytes()


def test_one_failing_scene_is_reported(
    shell: Shell, data: Path, tmp_path: Path, sideways: None
):
    out = tmp_path / "out"
    command = ("evaluate", "--data", data, "--out", out, "--workers", 1)
    result = shell.run(*command, "--methods", "ground-truth", "raises-on-bbb")
    assert result.code == 0
    assert result.lines[-1] == "1 failures; the report says which and why."
    text = (out / "report.md").read_text()
    assert "| bbb | none | raises-on-bbb | ZeroDivisionError: not this one |" in text
    assert "raises-on-bbb has 2 of 3 scenes" in text


def test_a_method_that_always_fails_exits_with_2(
    shell: Shell, data: Path, tmp_path: Path, sideways: None
):
    out = tmp_path / "out"
    command = ("evaluate", "--data", data, "--out", out, "--workers", 1)
    words = shell.refused(*command, "--methods", "ground-truth", "raises")
    assert words.startswith("raises: failed on every scene")
    assert "a generator's bug" in words
    assert (out / "report.md").exists()


def test_scenes_without_a_future(shell: Shell, data: Path, tmp_path: Path):
    gone = without_future(scenario_with(straight_drivers(COLLIDING)))
    write_scenario(data, "test", "ddd", gone)
    command = ("evaluate", "--workers", 1, "--methods", "ground-truth")
    words = shell.refused(*command, "--data", data / "test", "--out", tmp_path / "none")
    assert words.startswith("None of the 1 scenes has a logged future")
    result = shell.run(*command, "--data", data, "--out", tmp_path / "some")
    assert result.code == 0
    assert result.lines[-1] == "1 of 4 scenes have no future and were left out."


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--samples 0", "--samples is 0"),
        ("--seed -1", "--seed is -1"),
        ("--limit 0", "--limit is 0"),
        ("--workers 0", "--workers is 0"),
        ("--methods teleporter", "teleporter"),
        ("--warps bend:3", "bend:3"),
        ("--data nowhere", "no such dataset folder"),
        ("--data .", "no Argoverse 2 scenario"),
        ("--out taken", "cannot be written"),
        ("--development trian", "No scene is of the development split trian; the"),
    ],
)
def test_bad_input_is_refused_and_leaves_nothing(
    shell: Shell,
    data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: str,
    words: str,
):
    here = tmp_path / "here"
    here.mkdir()
    (here / "taken").write_text("")
    monkeypatch.chdir(here)
    given = {"--data": str(data), "--out": "out"}
    name, value = options.split()
    given[name] = value
    flat = [word for pair in given.items() for word in pair]
    assert words in shell.refused("evaluate", *flat)
    assert [path.name for path in here.iterdir()] == ["taken"]


def test_progress_in_words():
    def line(done: int, failed: int = 0) -> str:
        progress = WorkProgress(num_done=done, num_failed=failed, num_items=10)
        return progress_line(progress, 60.0, "scenes on roads")

    assert line(0) == "0 of 10 scenes on roads"
    assert (
        line(4, failed=1) == "4 of 10 scenes on roads, 1 failed, 4 a minute, 1:30 left"
    )
    assert line(10) == "10 of 10 scenes on roads, 10 a minute"


@pytest.mark.slow
@pytest.mark.real_data
def test_real_scenes(shell: Shell, av2_root: Path, tmp_path: Path):
    data = (av2_root / "train", av2_root / "val")
    options = ("--limit", 2, "--warps", "none", "double-turn:9", "--samples", 2)
    out = tmp_path / "out"
    result = shell.run("evaluate", "--data", *data, "--out", out, *options)
    check_done(result)
    rows = pq.read_table(out / "rows.parquet")
    log = rows.filter(
        [name == "ground-truth" for name in rows["method"].to_pylist()]
    ).to_pylist()
    assert {one["ade"] for one in log} == {0.0, None}
    assert {one["split"] for one in log} == {"train"}
    assert "Movers on their way, perturbed roads" in (out / "report.md").read_text()


@pytest.mark.slow
@pytest.mark.real_data
def test_whole_scenes_on_real_roads(shell: Shell, av2_root: Path, tmp_path: Path):
    options = ("--limit", 1, "--warps", "none", "double-turn:9", "--samples", 2)
    task = ("--states", "sampled", "--agents", "paper")
    out = tmp_path / "out"
    result = shell.run(
        "evaluate", "--data", av2_root / "val", "--out", out, *task, *options
    )
    check_done(result)
    rows = pq.read_table(out / "rows.parquet").to_pylist()
    for road in ("none", "double-turn"):
        log, placed = (
            [one for one in rows if (one["method"], one["warp"]) == (method, road)]
            for method in ("ground-truth", "path-diffuser")
        )
        assert {one["kind"] for one in log} == {"vehicle"}
        assert len(placed) == 2 * len(log) > 0
        assert max(one["nearest_edge"] for one in placed) <= 4.0
        assert {one["init_overlap"] for one in placed} == {0.0}


PLUGIN = """
import time
from examples.drift_generator import DriftGenerator

class Hangs(DriftGenerator):
    name = "hangs"
    def generate(self, request):
        if request.scenario.scenario_id == "ccc":
            while True:
                time.sleep(0.01)
        return (yield from super().generate(request))
"""


@pytest.mark.slow
def test_a_generator_of_ones_own_is_judged_and_one_that_hangs_fails_alone(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "my_hanging_plugin.py").write_text(PLUGIN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    result = shell.run(
        "evaluate", "--data", write_dataset(tmp_path / "data"), "--out", tmp_path / "out",
        "--methods", "ground-truth", "my_hanging_plugin:Hangs",
        "examples.constant_velocity:Predictor", "--samples", 2, "--workers", 1,
        "--time-limit", 3,
    )  # fmt: skip
    assert result.code == 0, result.err
    assert "1 failures; the report says which and why." in result.out
    table = pq.read_table(tmp_path / "out" / "rows.parquet")
    scenes = {
        (row["method"], row["scenario_id"])
        for row in table.select(["method", "scenario_id"]).to_pylist()
    }
    assert ("my_hanging_plugin:Hangs", "aaa") in scenes
    assert ("my_hanging_plugin:Hangs", "ccc") not in scenes
    assert ("examples.constant_velocity:Predictor", "ccc") in scenes
    report = (tmp_path / "out" / "report.md").read_text()
    assert "It gave no answer within 3 s." in report


def test_plugins_and_limits_that_are_no_good_are_refused(shell: Shell, tmp_path: Path):
    data = ("--data", write_dataset(tmp_path / "data"), "--out", tmp_path / "out")
    told = shell.refused("evaluate", *data, "--methods", "examples.drift:Generator")
    assert "examples.drift:Generator: cannot be imported" in told
    told = shell.refused("evaluate", *data, "--time-limit", 0)
    assert told == "--time-limit is 0 s; expected 0.1 to 86400."
    assert not (tmp_path / "out").exists()
