"""Studies from plan to folder: rows, failures, resumption, curves and worst cases."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pd_editor.analysis.metrics.scene_metrics import agent_values
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.base.errors import InputError
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.evaluation.evaluation import scenes_of
from pd_editor.experiments.evaluation.evaluation_task import (
    RoadCondition,
    road_conditions,
)
from pd_editor.experiments.studies.outcomes import (
    SearchItem,
    SearchSettings,
    grid_worst_cases,
    search_scene,
    severity_curves,
)
from pd_editor.experiments.studies.study_plan import (
    STUDY_AGENTS,
    STUDY_METRICS,
    VARIANTS_NAME,
    StudyPlan,
    grid_conditions,
    num_failed_variants,
    study_items,
    study_scene,
)
from pd_editor.experiments.studies.study_report import export_cases, worst_of_scenes
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import WorkProgress, progress_line
from pd_editor.scene.av2_io.read import read_scenario
from tests.experiments.evaluation.small_dataset import OneByOne, methods, write_dataset

POWERS = (-6.0, 6.0)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("data"))


def plan_for(root: Path, *names: str, **options) -> StudyPlan:
    options = {"conditions": grid_conditions(["smooth-turn"], POWERS)} | options
    return StudyPlan(data=(root,), methods=methods(*names), **options)


def run(plan: StudyPlan, out: Path, engine=None, *, resume=False):
    items = study_items(plan, scenes_of(plan.data, plan.limit).scenes)
    folder = plan.folder(out, resume=resume)
    return folder.run(study_scene, items, engine or OneByOne())


def test_the_grid_is_scene_attacks():
    conditions = grid_conditions()
    assert len(conditions) == 1 + 3 * 18
    assert conditions[0].is_plain
    assert {one.power for one in conditions[1:]} == {*range(-9, 0), *range(1, 10)}
    both = grid_conditions(["ripple-road"], [2.0], ["focal", "ego"])
    assert [one.label for one in both] == ["none", "ripple-road:2", "ripple-road:2@ego"]


def test_each_anchor_has_one_curve_over_all_powers(av2_root, tmp_path):
    """Ahead of the ego, each power was a curve of its own."""
    plan = StudyPlan(
        data=(av2_root / "train",),
        methods=methods("ground-truth"),
        conditions=(
            *grid_conditions(["ripple-road"], POWERS, ["focal", "ego"]),
            *road_conditions(["smooth-turn:6+ripple-road:2@ego"]),
        ),
        limit=1,
    )
    curves = severity_curves(run(plan, tmp_path / "out").rows)
    assert {one.road: one.power.tolist() for one in curves} == {
        "ripple-road": [-6, 0, 6],
        "ripple-road ahead of the ego": [-6, 0, 6],
        "smooth-turn:6+ripple-road:2 ahead of the ego": [0, 6],
    }


def test_progress_tells_rate_and_time_left():
    progress = WorkProgress(num_done=10, num_items=40, num_failed=1)
    assert progress_line(progress, 20.0, "work items") == (
        "10 of 40 work items, 1 failed, 30 a minute, 1:00 left"
    )
    assert "9 variants a second" in progress_line(progress, 20.0, "work items", 18.0)
    done = replace(progress, num_done=40, num_failed=0)
    assert progress_line(done, 20.0, "work items") == "40 of 40 work items, 2 a second"


@pytest.mark.parametrize(
    "grid", [(["bend"], [1.0]), (["ripple-road"], [11.0]), (["ripple-road"], [0.0]),
             (["ripple-road"], [float("nan")]), (["ripple-road"], [1.0], ["x"])]
)  # fmt: skip
def test_what_is_no_warp_is_refused(grid):
    with pytest.raises(InputError, match="expected"):
        grid_conditions(*grid)


def test_sums_are_those_of_the_metrics(root, tmp_path):
    record = run(plan_for(root, "ground-truth"), tmp_path / "out")
    rows = record.rows.to_pylist()
    assert len(rows) == 3 * 3 * len(STUDY_AGENTS)
    for folder in ("train/aaa", "val/ccc"):
        scenario = read_scenario(root / folder)
        values = agent_values(recorded_traffic(scenario))
        (row,) = (
            one
            for one in rows
            if one["folder"] == str(root / folder)
            and one["condition"] == "none"
            and one["agents"] == "movers"
        )
        for name in ("off_drivable_steps", "new_overlap", "lateral_deviation_mean"):
            expected = values[name].valid()
            assert row[f"{name}_count"] == len(expected)
            assert row[f"{name}_sum"] == pytest.approx(expected.sum())
    assert any(row["new_overlap_sum"] > 0 for row in rows)


def test_focal_rows_are_of_one_agent(root, tmp_path):
    record = run(plan_for(root, "constant-velocity"), tmp_path / "out")
    focal = [one for one in record.rows.to_pylist() if one["agents"] == "focal"]
    assert {one["ade_count"] for one in focal} == {1}


def test_a_method_that_raises_fails_where_it_raises(root, tmp_path):
    record = run(plan_for(root, "raises-on-bbb", "constant-velocity"), tmp_path / "out")
    assert (num_failed_variants(record.rows), record.failures) == (3, {})
    failed = {
        (one["method"], one["scenario_id"]): one["failure"]
        for one in record.rows.to_pylist()
        if one["failure"]
    }
    assert failed == {("raises-on-bbb", "bbb"): "ZeroDivisionError: not this one"}
    curves = severity_curves(record.rows)
    counts = {one.method: one.num_scenes.tolist() for one in curves}
    assert counts == {"raises-on-bbb": [2, 2, 2], "constant-velocity": [3, 3, 3]}


@pytest.mark.parametrize("name", ["nan", "short", "others", "few"])
def test_wrong_answers_fail_with_a_reason(root, tmp_path, name):
    record = run(plan_for(root, name, limit=1), tmp_path / "out")
    assert num_failed_variants(record.rows) == 3
    assert all(record.rows["failure"].to_pylist())


def test_a_study_that_was_killed_goes_on(root, tmp_path):
    plan = plan_for(root, "constant-velocity", "sideways", seeds=(0, 1))
    run(plan, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(plan, tmp_path / "killed", OneByOne(stop_after=5))
    engine = OneByOne()
    record = run(plan, tmp_path / "killed", engine, resume=True)
    assert (record.num_resumed, len(engine.keys)) == (5, 7)
    whole, again = (tmp_path / one / VARIANTS_NAME for one in ("whole", "killed"))
    assert whole.read_bytes() == again.read_bytes()


def test_processes_give_the_same_rows(root, tmp_path):
    plan = plan_for(root, "constant-velocity")
    here = run(plan, tmp_path / "here").rows
    assert run(plan, tmp_path / "two", LocalProcesses(num_workers=2)).rows.equals(here)


def test_a_folder_of_another_study_is_refused(root, tmp_path):
    run(plan_for(root, "constant-velocity"), tmp_path / "out")
    with pytest.raises(InputError, match="seeds"):
        run(
            plan_for(root, "constant-velocity", seeds=(3,)),
            tmp_path / "out",
            resume=True,
        )


def test_curves_are_means_over_agents(root, tmp_path):
    record = run(plan_for(root, "sideways", num_samples=2), tmp_path / "out")
    (curve,) = severity_curves(record.rows, "movers")
    assert curve.power.tolist() == [-6.0, 0.0, 6.0]
    rows = [one for one in record.rows.to_pylist() if one["agents"] == "movers"]
    for index, power in enumerate(curve.power):
        here = [one for one in rows if one["power"] == power]
        for name in STUDY_METRICS:
            total = sum(one[f"{name}_sum"] for one in here)
            count = sum(one[f"{name}_count"] for one in here)
            if count:
                found = curve.estimates[name].value[index]
                assert found == pytest.approx(total / count)
    assert not severity_curves(record.rows.slice(0, 0))


def test_the_worst_of_the_grid_is_its_greatest_value(root, tmp_path):
    record = run(plan_for(root, "constant-velocity"), tmp_path / "out")
    settings = SearchSettings(metric="lateral_deviation_mean", agents="movers")
    cases = grid_worst_cases(record.rows, settings)
    assert {one.scenario for one in cases} == {"aaa", "bbb", "ccc"}
    for one in cases:
        values = [
            row["lateral_deviation_mean_sum"] / row["lateral_deviation_mean_count"]
            for row in record.rows.to_pylist()
            if row["scenario_id"] == one.scenario and row["agents"] == "movers"
        ]
        assert one.value == pytest.approx(max(values))


def search_of(root: Path, name: str, **options):
    plan = plan_for(root, name)
    items = study_items(plan, scenes_of(plan.data).scenes)
    item = next(iter(items.values()))
    settings = SearchSettings(
        metric="lateral_deviation_mean", agents="movers", num_trials=20, **options
    )
    return search_scene(SearchItem(variant=item, settings=settings))


def test_a_search_is_as_bad_as_the_grid_and_repeats(root, tmp_path):
    plan = plan_for(root, "constant-velocity", conditions=grid_conditions())
    settings = SearchSettings(metric="lateral_deviation_mean", agents="movers")
    record = run(replace(plan, limit=1), tmp_path / "out")
    (grid,) = grid_worst_cases(record.rows, settings)
    found = search_of(root, "constant-velocity")
    assert found.scenario == grid.scenario
    assert found.value >= grid.value
    assert found == search_of(root, "constant-velocity")


def test_the_penalty_keeps_to_one_kind(root):
    (penalised,) = road_conditions([search_of(root, "constant-velocity").condition])
    assert len(penalised.terms) == 1
    free = search_of(root, "constant-velocity", penalty=0.0)
    assert free.value >= search_of(root, "constant-velocity").value


def test_a_search_whose_method_always_fails_has_no_worst_case(root):
    found = search_of(root, "raises")
    assert found.condition == ""
    assert np.isnan(found.value)
    assert not worst_of_scenes([found], 3)


def test_worst_cases_are_exported_for_the_editor(root, tmp_path):
    plan = plan_for(root, "constant-velocity")
    items = study_items(plan, scenes_of(plan.data).scenes)
    folder = plan.folder(tmp_path / "out", resume=False)
    record = folder.run(study_scene, items, OneByOne())
    settings = SearchSettings(metric="lateral_deviation_mean", agents="movers")
    cases = worst_of_scenes(grid_worst_cases(record.rows, settings), 2)
    entries, failures = export_cases(cases, list(items.values()), tmp_path / "gallery")
    assert not failures
    assert len(entries) == 2
    for entry in entries:
        scenario = open_scenario(entry.folder)
        assert scenario.provenance.is_bent == (entry.case.condition != "none")
        assert entry.thumbnail.startswith("<svg")
        recipe = Recipe.from_text((entry.folder / "recipe.json").read_bytes())
        assert recipe.variant.is_proposed
        assert recipe.result_id == scenario.scenario_id == entry.folder.name
        (condition,) = road_conditions([entry.case.condition])
        item = next(
            one for one in items.values() if one.folder.name == entry.case.scenario
        )
        request = item.request(read_scenario(item.folder), condition)
        (view,) = item.method.traffic(request).samples
        rows = scenario.agents.rows(view.agents.ids)
        found = scenario.agents.position_m[rows, scenario.current_step :]
        assert np.allclose(found, view.agents.position_m, atol=1e-3)


def test_scenes_of_one_id_are_studied_apart(tmp_path):
    """An original and a copy: the worst of each is exported, of its own folder."""
    root = write_dataset(tmp_path / "data")
    shutil.copytree(root / "val", root / "copies")
    (root / "copies" / "ccc").rename(root / "copies" / "renamed")
    plan = plan_for(root, "constant-velocity")
    items = study_items(plan, scenes_of(plan.data).scenes)
    folder = plan.folder(tmp_path / "out", resume=False)
    record = folder.run(study_scene, items, OneByOne())
    settings = SearchSettings(metric="lateral_deviation_mean", agents="movers")
    cases = worst_of_scenes(grid_worst_cases(record.rows, settings), 10)
    assert {case.folder for case in cases} == {item.folder for item in items.values()}
    gallery = tmp_path / "gallery"
    entries, failures = export_cases(cases, list(items.values()), gallery)
    assert not failures
    assert len({entry.folder for entry in entries}) == len(entries) == 4


def test_an_anchor_that_is_not_there_fails_alone(root, tmp_path):
    ego = RoadCondition(terms=(("smooth-turn", 3.0),), anchor="ego")
    plan = plan_for(
        root, "constant-velocity", conditions=(RoadCondition(), ego), limit=1
    )
    record = run(plan, tmp_path / "out")
    reasons = set(record.rows["failure"].to_pylist())
    assert num_failed_variants(record.rows) == 1
    assert any(reason and "ego" in reason for reason in reasons)
