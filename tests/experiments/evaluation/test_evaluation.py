import json
from importlib.metadata import version
from pathlib import Path

import pytest

from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import demo_folder, demo_names
from pd_editor.experiments.evaluation.evaluation import (
    ROWS_NAME,
    run_evaluation,
    scenes_of,
)
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from tests.builders import scenario_with, straight_drivers
from tests.experiments.evaluation.small_dataset import (
    COLLIDING,
    OneByOne,
    plan_for,
    without_future,
    write_dataset,
    write_scenario,
)

NAMES = ("ground-truth", "random-candidate", "sideways")
WARPS = ("none", "smooth-turn:3")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "data")


def run(plan, out: Path, engine=None, *, resume=False):
    folder = plan.folder(out, resume=resume)
    record = run_evaluation(
        plan, scenes_of(plan.data, plan.limit), folder, engine or OneByOne()
    )
    return record, (out / ROWS_NAME).read_bytes()


@pytest.mark.slow
def test_rows_do_not_depend_on_the_workers(root, tmp_path):
    plan = plan_for(root, *NAMES, warps=WARPS)
    record, rows = run(plan, tmp_path / "here")
    assert (record.num_scenes, record.num_items, record.failures) == (3, 6, ())
    for workers in (1, 2):
        engine = LocalProcesses(num_workers=workers)
        assert run(plan, tmp_path / str(workers), engine)[1] == rows
    other = plan_for(root, *NAMES, warps=WARPS, seed=1)
    assert run(other, tmp_path / "seed")[1] != rows


def test_a_run_that_was_killed_goes_on(root, tmp_path):
    plan = plan_for(root, *NAMES, warps=WARPS)
    _, rows = run(plan, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(plan, tmp_path / "killed", OneByOne(stop_after=4))
    assert not (tmp_path / "killed" / ROWS_NAME).exists()
    engine = OneByOne()
    record, again = run(plan, tmp_path / "killed", engine, resume=True)
    assert again == rows
    assert engine.keys == ["val/ccc/none", "val/ccc/smooth-turn_3"]
    assert record.num_resumed == 4


def test_more_roads_and_scenes_may_be_added(root, tmp_path):
    first = plan_for(root, *NAMES, limit=1)
    assert run(first, tmp_path / "out")[0].num_scenes == 1
    whole = plan_for(root, *NAMES, warps=WARPS)
    record, rows = run(whole, tmp_path / "out", resume=True)
    assert (record.num_resumed, record.num_items) == (1, 6)
    assert rows == run(whole, tmp_path / "anew")[1]


def test_scenes_fail_alone_and_are_tried_again(root, tmp_path):
    plan = plan_for(root, "ground-truth", "raises-on-bbb")
    record, _ = run(plan, tmp_path / "out")
    (failure,) = record.failures
    assert (failure.scene, failure.condition, failure.method) == (
        "bbb",
        "none",
        "raises-on-bbb",
    )
    assert failure.reason == "ZeroDivisionError: not this one"
    engine = OneByOne()
    run(plan, tmp_path / "out", engine, resume=True)
    assert engine.keys == ["train/bbb/none"]


def test_scenes_that_cannot_be_judged_are_said_and_counted(root, tmp_path):
    gone = without_future(scenario_with(straight_drivers(COLLIDING)))
    write_scenario(root, "val", "ddd", gone)
    (root / "train" / "aaa" / "log_map_archive_aaa.json").write_text("{")
    (root / "train" / "bbb" / "scenario_bbb.parquet").write_bytes(b"no parquet")
    record, _ = run(plan_for(root, "ground-truth", warps=WARPS), tmp_path / "out")
    assert record.without_future == ("ddd",)
    assert record.num_skipped_folders == 1
    assert [(one.scene, one.method) for one in record.failures] == [("aaa", "")] * 2
    assert record.num_scenes == 3


def test_progress_counts_what_is_left(root, tmp_path):
    plan, seen = plan_for(root, "ground-truth"), []
    folder = plan.folder(tmp_path / "out", resume=False)
    run_evaluation(
        plan,
        scenes_of(plan.data, plan.limit),
        folder,
        OneByOne(),
        on_progress=seen.append,
    )
    assert [(one.num_done, one.num_items) for one in seen] == [
        (done, 3) for done in range(4)
    ]


def test_roots_name_the_splits(root, tmp_path):
    whole = scenes_of([root]).scenes
    assert [(one.split, one.folder.name) for one in whole] == [
        ("train", "aaa"),
        ("train", "bbb"),
        ("val", "ccc"),
    ]
    part = scenes_of([root / "train"]).scenes
    assert part == whole[:2]


def test_demos_are_found_by_name(tmp_path, monkeypatch):
    names = [one.folder.name for one in scenes_of([Path("demos")]).scenes]
    assert names == list(demo_names())
    for name in ("roundabout", "demo:roundabout"):
        (one,) = scenes_of([Path(name)]).scenes
        assert one.folder == demo_folder("roundabout")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demos").mkdir()
    with pytest.raises(InputError, match="demos"):
        scenes_of([Path("demos")])


def test_roots_that_cannot_be_used(root, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no Argoverse 2 scenario"):
        scenes_of([tmp_path / "empty"])
    with pytest.raises(InputError, match="no such dataset folder"):
        scenes_of([tmp_path / "nowhere"])
    write_scenario(
        root / "again", "train", "aaa", scenario_with(straight_drivers(COLLIDING))
    )
    with pytest.raises(InputError, match="found before"):
        scenes_of([root / "train", root / "again" / "train"])


def test_settings_are_written_down(root, tmp_path):
    run(plan_for(root, "ground-truth"), tmp_path / "out")
    settings = json.loads((tmp_path / "out" / "settings.json").read_text())
    assert settings == {
        "version": version("pd-editor"),
        "data": [str(root)],
        "methods": ["ground-truth"],
        "samples": 2,
        "seed": 0,
        "states": "recorded",
        "agents": "all",
        "current_s": None,
        "map_parts": [],
    }
