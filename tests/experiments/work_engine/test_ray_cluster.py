import sys
import time
from pathlib import Path

import pytest

from pd_editor.base.errors import InputError
from pd_editor.experiments.work_engine.ray_cluster import RayCluster
from pd_editor.experiments.work_engine.work_engine import WorkEngine, run_items
from pd_editor.scene.formats.registry import REFERENCES
from tests.experiments.work_engine.fake_ray import FakeRay
from tests.experiments.work_engine.work_functions import (
    fails_for_the_user,
    kills_its_first_worker,
    square,
    square_of_odd,
    threads,
    working_folder,
)

ENGINE = RayCluster(num_workers=2)
# Ray leaves sockets and files of its own processes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


def results_of(function, items) -> dict:
    found = {}
    failures = run_items(ENGINE, function, items, on_value=found.__setitem__)
    assert not found.keys() & failures
    return found | failures


def test_it_is_a_work_engine():
    assert isinstance(ENGINE, WorkEngine)


def test_without_ray_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match="cluster"):
        results_of(square, {"1": 1})


def test_no_items_need_no_cluster(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert results_of(square, {}) == {}


def test_workers_know_what_the_caller_does(monkeypatch, tmp_path: Path):
    """They are asked for by relative paths, and for formats that were added."""
    fake = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", fake)
    monkeypatch.setenv(REFERENCES, "examples.csv_format:FORMAT")
    monkeypatch.chdir(tmp_path)
    assert results_of(working_folder, {"1": 1}) == {"1": str(tmp_path)}
    (started,) = fake.started
    env = started["runtime_env"]["env_vars"]
    assert env[REFERENCES] == "examples.csv_format:FORMAT"


@pytest.mark.slow
def test_results_are_those_of_processes():
    items = {str(number): number for number in range(12)}
    assert results_of(square, items) == {key: one**2 for key, one in items.items()}
    found = results_of(square_of_odd, items)
    assert [found[str(one)] for one in (1, 3, 5)] == [1, 9, 25]
    assert (found["4"].error, found["4"].message) == ("ValueError", "4 is even")
    assert results_of(fails_for_the_user, {"1": 1})["1"].is_users
    assert results_of(threads, {"1": 1}) == {"1": ("1", 1)}


@pytest.mark.slow
def test_a_killed_worker_loses_no_item(tmp_path: Path):
    items = {str(number): (tmp_path, number) for number in range(8)}
    found = results_of(kills_its_first_worker, items)
    assert found == {str(number): number for number in range(8)}
    assert (tmp_path / "killed").exists()


@pytest.mark.slow
def test_a_cluster_that_does_not_answer_is_said():
    engine = RayCluster(address="ray://127.0.0.1:1")
    began = time.monotonic()
    with pytest.raises(InputError, match=r"127\.0\.0\.1:1"):
        run_items(engine, square, {"1": 1}, on_value=lambda *_: None)
    assert time.monotonic() - began < 120
