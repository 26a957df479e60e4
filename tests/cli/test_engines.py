"""The three commands that scale out: same options, same results on both engines."""

import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from pd_editor.experiments.synthesis import dataset_builder
from tests.cli.shell import Shell
from tests.experiments.evaluation.small_dataset import write_dataset
from tests.experiments.recordings.recordings import drive
from tests.experiments.work_engine.fake_ray import FakeRay

METHODS = ("--methods", "ground-truth", "constant-velocity")
COMMANDS = {
    "study": (
        *("--kinds", "ripple-road", "--powers", 6, "--gallery", 0, "--search", 2),
        *METHODS[:1],
        METHODS[2],
    ),
    "evaluate": (*METHODS, "--warps", "none", "ripple-road:6", "--samples", 2),
    "synth": ("--num", 6, "--families", "grid", "town", "--shards"),
}
ROWS = {"study": "variants.parquet", "evaluate": "rows.parquet"}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "data")


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch, no_processes: None) -> FakeRay:
    """No cluster, no SUMO."""
    fake = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", fake)
    monkeypatch.setattr(
        dataset_builder,
        "_recording",
        lambda item: drive(seed=item.seed, name=item.key),
    )
    return fake


def words(command: str, data: Path, out: Path, *options: object) -> Sequence[object]:
    source = () if command == "synth" else ("--data", data)
    return (command, *source, "--out", out, *COMMANDS[command], *options)


def results_of(command: str, out: Path) -> dict[str, bytes]:
    """Rows of a study or evaluation; all files of a synthetic dataset."""
    if command in ROWS:
        return {ROWS[command]: (out / ROWS[command]).read_bytes()}
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file()
    }


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_results_on_ray_are_those_of_processes(
    shell: Shell, ray: FakeRay, data: Path, tmp_path: Path, command: str
):
    """Also after tasks were lost for good, once the run is resumed."""
    assert shell.run(*words(command, data, tmp_path / "here")).code == 0
    expected = results_of(command, tmp_path / "here")
    assert not ray.started
    out = tmp_path / "there"
    on_ray = words(command, data, out, "--engine", "ray", "--workers", 2)
    assert shell.run(*on_ray).code == 0
    assert results_of(command, out) == expected
    (started,) = ray.started
    assert started["address"] == "local"
    assert started["num_cpus"] == 2
    assert started["runtime_env"]["env_vars"]["OMP_NUM_THREADS"] == "1"
    assert ray.num_ended == 1
    if command == "synth":  # It makes up for lost networks by further ones at once.
        return
    lossy = words(command, data, tmp_path / "lossy", "--engine", "ray")
    ray.num_losses = 1
    assert shell.run(*lossy).code == 0
    assert results_of(command, tmp_path / "lossy") != expected
    assert shell.run(*lossy, "--resume").code == 0
    assert results_of(command, tmp_path / "lossy") == expected


def driven(shell: Shell, out: Path, *options: object) -> dict[str, bytes]:
    """All files of drives but the reports, which name the command."""
    demos = ("signalised-junction", "roundabout")
    policies = ("--policies", "idm", "constant-velocity")
    usual = ("--seconds", 2, "--seed", 5, "--model", "path-diffuser", "--out", out)
    shell.run("drive", *demos, *policies, *usual, *options)
    files = results_of("drive", out)
    return {name: data for name, data in files.items() if "report." not in name}


@pytest.mark.slow
def test_drives_on_ray_are_those_of_processes(
    shell: Shell, ray: FakeRay, tmp_path: Path
):
    """Also after a task was lost for good, once the drives are gone on with."""
    expected = driven(shell, tmp_path / "here")
    assert sum(name.endswith("recipe.json") for name in expected) == 4
    options = ("--engine", "ray", "--workers", 2)
    assert driven(shell, tmp_path / "there", *options) == expected
    assert len(ray.started) == 1
    ray.num_losses = 1
    assert driven(shell, tmp_path / "lossy", *options) != expected
    assert driven(shell, tmp_path / "lossy", *options) == expected


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_drives_on_a_real_cluster_are_those_of_processes(shell: Shell, tmp_path: Path):
    expected = driven(shell, tmp_path / "here")
    assert driven(shell, tmp_path / "local", "--workers", 2) == expected
    options = ("--engine", "ray", "--workers", 2)
    assert driven(shell, tmp_path / "ray", *options) == expected


@pytest.mark.parametrize("command", COMMANDS)
def test_engines_that_cannot_be_used_are_one_sentence(
    shell: Shell,
    ray: FakeRay,
    data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
):
    out = tmp_path / "out"
    assert "--address is for --engine ray" in shell.refused(
        *words(command, data, out, "--address", "auto")
    )
    assert "--workers is 0" in shell.refused(*words(command, data, out, "--workers", 0))
    on_ray = words(command, data, out, "--engine", "ray")
    said = shell.refused(*on_ray, "--address", "127.0.0.1:1")
    assert "Ray cluster at 127.0.0.1:1 cannot be used: Connection refused" in said
    monkeypatch.setitem(sys.modules, "ray", None)
    assert "pip install 'pd-editor[cluster]'" in shell.refused(*on_ray)
    assert not ray.started
    assert not out.exists()


def test_an_existing_cluster_runs_as_many_items_as_asked_for(
    shell: Shell, ray: FakeRay, data: Path, tmp_path: Path
):
    options = ("--engine", "ray", "--address", "auto", "--workers", 3)
    assert shell.run(*words("evaluate", data, tmp_path / "out", *options)).code == 0
    assert ray.most_running == 3
    assert ray.started[0]["address"] == "auto"
    assert "num_cpus" not in ray.started[0]


def ray_tasks() -> list[int]:
    """Processes that run a task of Ray and descend from this one."""
    parents, tasks = {}, []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            status = (folder / "stat").read_text()
            line = (folder / "cmdline").read_bytes()
        except OSError:
            continue
        number = int(folder.name)
        parents[number] = int(status.rpartition(")")[2].split()[1])
        if line.startswith(b"ray::_result_in"):
            tasks.append(number)

    def is_ours(number: int) -> bool:
        while number in parents:
            if number == os.getpid():
                return True
            number = parents[number]
        return False

    return [number for number in tasks if is_ours(number)]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_killed_worker_of_ray_changes_no_result(
    shell: Shell, data: Path, tmp_path: Path, command: str
):
    assert shell.run(*words(command, data, tmp_path / "here")).code == 0
    killed: list[int] = []
    is_over = threading.Event()

    def kill() -> None:
        while not killed and not is_over.is_set():
            for number in ray_tasks()[:1]:
                os.kill(number, signal.SIGKILL)
                killed.append(number)
            time.sleep(0.01)

    killer = threading.Thread(target=kill)
    killer.start()
    out = tmp_path / "there"
    try:
        options = ("--engine", "ray", "--workers", 2)
        result = shell.run(*words(command, data, out, *options))
    finally:
        is_over.set()
        killer.join()
    assert result.code == 0, result.err
    assert killed
    assert results_of(command, out) == results_of(command, tmp_path / "here")
