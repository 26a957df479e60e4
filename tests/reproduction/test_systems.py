import json
from pathlib import Path

import pytest

from pd_editor.base.errors import InputError
from pd_editor.experiments.evaluation.evaluation import EvaluationPlan
from pd_editor.experiments.evaluation.evaluation_task import road_conditions
from reproduction.plans import paper_plan
from reproduction.systems import in_table_order, label_of, trained_systems


def write_model(folder: Path, *own: str, stages=("init", "traj"), warps=0.0) -> None:
    """A model folder without weights; ``own`` are the stages with runs in it."""
    for stage in own:
        (folder / "runs" / stage).mkdir(parents=True)
    folder.mkdir(exist_ok=True)
    entry = {"training": {"augmentation": {"warp_share": warps}}}
    content = {"stages": dict.fromkeys(stages, entry)}
    (folder / "config.json").write_text(json.dumps(content))


@pytest.fixture
def variants(tmp_path: Path) -> Path:
    write_model(tmp_path / "pd-seed0", "init", "traj")
    write_model(tmp_path / "pd-seed1", "init", "traj")
    write_model(tmp_path / "mha-seed0", "init")
    write_model(tmp_path / "pd_with_warps-seed0", "traj", warps=0.3)
    write_model(tmp_path / "my-own")
    (tmp_path / "corpus").mkdir()
    return tmp_path


def test_variants_are_found_with_their_seeds_and_own_stages(variants: Path):
    found = {(one.system, one.seed): one for one in trained_systems([variants])}
    assert set(found) == {
        ("pd", 0),
        ("pd", 1),
        ("mha", 0),
        ("pd_with_warps", 0),
        ("my-own", 0),
    }
    assert found["mha", 0].stages == ("init",)
    assert found["pd", 1].stages == ("init", "traj")
    assert found["my-own", 0].stages == ("init", "traj")
    assert found["pd_with_warps", 0].warp_share == 0.3
    assert found["pd_with_warps", 0].saw_warps
    assert not found["pd", 0].saw_warps
    assert found["pd_with_warps", 0].method == str(variants / "pd_with_warps-seed0")


def test_a_shipped_model_that_is_named_as_well_is_found_once(variants: Path):
    shipped = [("mine", variants / "my-own")]
    found = [one.method for one in trained_systems([variants], shipped)]
    assert found.count("mine") == 1
    assert str(variants / "my-own") not in found


def test_what_trainings_before_the_record_saw_is_known(tmp_path: Path):
    entry = {"training": {"start": "earlier", "augmentation": {"warp_share": 0.0}}}
    for name, of_stage in (("old", {"training": {}}), ("started", entry)):
        (tmp_path / name).mkdir()
        content = {"stages": {"init": of_stage, "traj": of_stage}}
        (tmp_path / name / "config.json").write_text(json.dumps(content))
    found = {one.system: one for one in trained_systems([tmp_path])}
    assert found["old"].warp_share == 0.3
    assert found["started"].saw_warps
    assert found["started"].start == "earlier"


def test_the_order_and_names_of_the_paper():
    names = in_table_order(["zebra", "pd", "mha", "ground-truth", "pd", "vd"])
    assert names == ("ground-truth", "mha", "vd", "pd", "zebra")
    assert [label_of(one) for one in names] == ["GT", "MHA", "VD", "PD", "zebra"]


def test_a_folder_without_models_is_refused(tmp_path: Path):
    with pytest.raises(
        InputError, match=r"holds no trained model; expected config\.json"
    ):
        trained_systems([tmp_path / "nothing"])
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "config.json").write_text("[")
    with pytest.raises(InputError, match="holds no trained model"):
        trained_systems([tmp_path])


def test_each_model_is_judged_in_its_own_tables_unguided_and_guided(variants: Path):
    base = EvaluationPlan(
        data=(variants,),
        methods=(),
        conditions=road_conditions(["all"]),
        num_samples=2,
        seed=0,
    )
    plan = paper_plan(base, trained_systems([variants]), lambda _: None)
    of_states = {(one.system, one.seed, one.mode) for one in plan.states.entries}
    assert ("mha", 0, "unguided") in of_states
    assert ("pd", 1, "guided") in of_states
    assert not any(system == "pd_with_warps" for system, _, _ in of_states)
    driven = {(one.system, one.mode) for one in plan.everyone.entries}
    assert ("mha", "guided") not in driven
    assert {("constant-velocity", ""), ("lane-follower", "")} <= driven
    assert [one.is_plain for one in plan.states.plan.conditions] == [True]
    assert len(plan.everyone.plan.conditions) == 10
    assert plan.paper.plan.task.agents == plan.states.plan.task.agents == "paper"
    raw = next(one for one in plan.paper.entries if one.mode == "unguided")
    assert raw.method.options == {"raw": 1.0}
    guided = next(one for one in plan.paper.entries if one.mode == "guided")
    assert guided.method.options == {"tries": 0.0}
