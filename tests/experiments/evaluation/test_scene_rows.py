from dataclasses import replace

import pytest

from pd_editor.base.errors import EditError, InputError
from pd_editor.experiments.evaluation.evaluation_task import (
    EvaluationTask,
    RoadCondition,
)
from pd_editor.experiments.evaluation.method import Method
from pd_editor.experiments.evaluation.scene_rows import (
    ROW_SCHEMA,
    SceneItem,
    evaluate_scene,
)
from tests.builders import scenario_with, straight_drivers
from tests.editor.fake_generators import PlacingGenerator
from tests.experiments.evaluation.small_dataset import (
    COLLIDING,
    methods,
    without_future,
    write_scenario,
)


def judged(tmp_path, *names, scenario=None, **options):
    scenario = scenario or scenario_with(straight_drivers(COLLIDING))
    folder = write_scenario(tmp_path, "train", "aaa", scenario)
    return evaluate_scene(item(folder, *names, **options))


def item(folder, *names, condition=None, num_samples=2):
    return SceneItem(
        folder=folder,
        split="train",
        condition=condition or RoadCondition(),
        methods=methods(*names),
        num_samples=num_samples,
        seed=0,
    )


def rows_of(rows, method, sample):
    return [
        one
        for one in rows.table.to_pylist()
        if (one["method"], one["sample"]) == (method, sample)
    ]


def test_known_values_of_known_traffic(tmp_path):
    rows = judged(tmp_path, "ground-truth", "constant-velocity", "sideways")
    assert rows.table.schema == ROW_SCHEMA
    assert not rows.failures
    assert rows.model_sha256["sideways"] == "abc123"
    # Two agents; one sample and one word about all of them, but two of a generator.
    assert len(rows.table) == 2 * (2 + 2 + 3)
    log = rows_of(rows, "ground-truth", 0)
    constant = rows_of(rows, "constant-velocity", 0)
    for one in (*log, *constant):
        assert one["ade"] == pytest.approx(0, abs=1e-4)
        assert one["new_overlap"] == 1.0
        assert one["recorded"] == 1.0
        assert (one["scenario_id"], one["split"], one["kind"], one["group"]) == (
            "aaa",
            "train",
            "vehicle",
            "movers",
        )
    assert [one["path_length"] for one in log] == pytest.approx([60.0, 0.0], abs=1e-3)
    for sample in (0, 1):
        first, second = rows_of(rows, "sideways", sample)
        assert second["ade"] == pytest.approx(1 + sample, abs=1e-3)
        assert second["lateral_deviation_final"] == pytest.approx(
            [1.0, 1.5][sample], abs=1e-2
        )
        assert first["new_overlap"] == 0.0
    together = rows_of(rows, "sideways", None)
    assert [one["end_spread"] for one in together] == pytest.approx([1.0, 1.0])
    assert together[1]["min_ade"] == pytest.approx(1.0, abs=1e-3)
    assert together[0]["ade"] is None
    assert log[0]["min_ade"] is None


def test_drawn_states_are_told_of_themselves(tmp_path):
    road_edge = [(0.0, 0.0, 0.0, 10.0), (20.0, 0.0, 0.0, 10.0)]
    folder = write_scenario(
        tmp_path, "train", "aaa", scenario_with(straight_drivers(road_edge))
    )
    placing = Method(name="placing", make_generator=lambda _name: PlacingGenerator())
    rows = evaluate_scene(
        replace(
            item(folder, "ground-truth", num_samples=6),
            methods=(*methods("ground-truth", "constant-velocity"), placing),
            task=EvaluationTask(states="sampled"),
        )
    )
    assert rows.failures == {
        "constant-velocity": "constant-velocity samples no initial states."
    }
    assert len(rows.table) == 2 * (1 + 6)
    log = rows_of(rows, "ground-truth", 0)
    assert [one["under_way"] for one in log] == [True, True]
    for sample in range(6):
        drawn = rows_of(rows, "placing", sample)
        # Sample k stands k m beside the middle of the first lane.
        assert [one["under_way"] for one in drawn] == [False, False]
        assert [one["on_lane"] for one in drawn] == [True, True]
        assert [one["recorded"] for one in drawn] == [1.0, 1.0]
        assert [one["nearest_distance"] for one in drawn] == pytest.approx([8.0, 8.0])
    # No sampled agent is one of the log or of another sample.
    for name in ("ade", "fde", "missed", "min_ade", "end_spread"):
        assert set(rows.table[name].to_pylist()) == {None}


def test_what_is_not_valid_is_null(tmp_path):
    agents = straight_drivers([(0, 0, 0, 10)])
    rows = judged(tmp_path, "ground-truth", scenario=scenario_with(agents))
    (alone,) = rows_of(rows, "ground-truth", 0)
    assert alone["local_density"] == []
    assert alone["starts"] is None


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("raises", "ZeroDivisionError: a generator's bug"),
        (
            "nan",
            "The generated position_m of agent 100, step 1 is nan; expected finite "
            "numbers.",
        ),
        ("short", "Sample 0: size"),
        ("few", "1 samples came back, 2 were asked for."),
        ("others", "Sample 0 holds other agents than were asked for."),
    ],
)
def test_a_method_that_fails_stops_no_other(tmp_path, name, reason):
    rows = judged(tmp_path, "ground-truth", name, "sideways")
    if name == "short":
        reason = "Sample 0: position_m has the shape (2, 60, 2); expected (2, 61, 2)."
    assert rows.failures == {name: reason}
    assert set(rows.table["method"].to_pylist()) == {"ground-truth", "sideways"}


def test_a_scene_without_a_future_has_no_rows(tmp_path):
    scenario = without_future(scenario_with(straight_drivers(COLLIDING)))
    rows = judged(tmp_path, "ground-truth", scenario=scenario)
    assert (len(rows.table), rows.has_future) == (0, False)


def test_the_log_is_bent_with_the_map(tmp_path):
    bend = RoadCondition(terms=(("smooth-turn", 9.0),))
    lane = [(0.0, 0.0, 0.0, 10.0)]
    rows = judged(
        tmp_path,
        "ground-truth",
        "constant-velocity",
        scenario=scenario_with(straight_drivers(lane)),
        condition=bend,
    )
    (log,), (constant,) = (
        rows_of(rows, name, 0) for name in ("ground-truth", "constant-velocity")
    )
    assert (log["warp"], log["power"]) == ("smooth-turn", 9.0)
    assert log["lateral_deviation_final"] < 0.05
    assert log["ade"] == 0.0
    assert constant["ade"] > 5
    assert constant["lateral_deviation_final"] > 5


def test_scenes_that_cannot_be_used_say_why(tmp_path):
    no_focal = replace(scenario_with(straight_drivers(COLLIDING)), focal_id="")
    folder = write_scenario(tmp_path, "train", "bbb", no_focal)
    bend = RoadCondition(terms=(("ripple-road", 3.0),))
    with pytest.raises(EditError, match="focal"):
        evaluate_scene(item(folder, "ground-truth", condition=bend))
    (folder / "log_map_archive_bbb.json").write_text("{")
    with pytest.raises(InputError):
        evaluate_scene(item(folder, "ground-truth"))
