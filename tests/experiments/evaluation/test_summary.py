from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.experiments.evaluation.evaluation_task import road_conditions
from pd_editor.experiments.evaluation.scene_rows import ROW_SCHEMA
from pd_editor.experiments.evaluation.summary import FAR_FROM_LANE, Summary, summarise

METHODS = ("ground-truth", "other")
ROADS = ("none", "smooth-turn:3", "ripple-road:6")


def row(scene, method, agent, ade, **more):
    base = {
        "scenario_id": scene,
        "split": "train",
        "method": method,
        "warp": "none",
        "power": 0.0,
        "sample": 0,
        "agent_id": agent,
        "group": "movers",
        "recorded": 1.0,
        "under_way": True,
        "on_lane": True,
        "ade": ade,
    }
    return base | more


def summary_of(tmp_path: Path, rows: list[dict], roads=("none",)) -> Summary:
    path = tmp_path / "rows.parquet"
    filled = [dict.fromkeys(ROW_SCHEMA.names) | one for one in rows]
    pq.write_table(pa.Table.from_pylist(filled, ROW_SCHEMA), path)
    return summarise(path, METHODS, road_conditions(roads), seed=0)


def at(summary: Summary, method: str, road: str, group: str) -> tuple[int, int, int]:
    return (
        summary.methods.index(method),
        summary.roads.index(road),
        summary.groups.index(group),
    )


def test_means_by_hand(tmp_path):
    summary = summary_of(
        tmp_path,
        [
            row("a", "other", "1", 1.0),
            row("a", "other", "1", 3.0, sample=1),
            row("a", "other", "2", 8.0),
            row("a", "other", "2", None, sample=1),
            row("b", "other", "1", 2.0, under_way=False),
            row("b", "other", "2", 6.0, on_lane=False),
            row("b", "other", "9", 50.0, group="pedestrians"),
            row("b", "other", "7", 99.0, group=None),
        ],
    )
    ade = summary.statistics["ade"]
    movers = at(summary, "other", "none", "movers")
    assert ade.mean.value[movers] == 4.0
    assert (ade.mean.low[movers], ade.mean.high[movers]) == (4.0, 4.0)
    assert ade.num_scenes[movers] == 2
    assert (summary.num_agents[movers], summary.num_scenes[movers]) == (4, 2)
    under_way = at(summary, "other", "none", "movers on their way")
    assert ade.mean.value[under_way] == 4.0
    assert summary.num_agents[under_way] == 2
    assert ade.mean.value[at(summary, "other", "none", "pedestrians")] == 50.0
    assert np.isnan(ade.mean.value[at(summary, "other", "none", "cyclists")])
    assert np.isnan(ade.mean.value[at(summary, "ground-truth", "none", "movers")])


def test_differences_pair_the_same_agents_on_the_same_road(tmp_path):
    summary = summary_of(
        tmp_path,
        [
            row("a", "ground-truth", "1", 1.0),
            row("a", "ground-truth", "2", 10.0, recorded=0.5),
            row("b", "ground-truth", "1", 5.0),
            row("b", "ground-truth", "3", None),
            row("a", "ground-truth", "1", 100.0, warp="smooth-turn", power=3.0),
            row("a", "other", "1", 2.0),
            row("a", "other", "1", 4.0, sample=1),
            row("a", "other", "2", 20.0, recorded=0.5),
            row("b", "other", "1", 4.0),
            row("b", "other", "3", 7.0),
            row("a", "other", "1", 101.0, warp="smooth-turn", power=3.0),
        ],
        ROADS,
    )
    ade = summary.statistics["ade"]
    plain = at(summary, "other", "none", "movers")
    assert ade.num_pairs[plain] == 3
    assert ade.difference.value[plain] == pytest.approx((1 + 3 - 1) / 3)
    assert ade.difference.value[at(summary, "other", "perturbed", "movers")] == 1.0
    own = at(summary, "ground-truth", "none", "movers")
    assert ade.difference.value[own] == 0.0


def test_values_over_all_samples_have_rows_of_their_own(tmp_path):
    summary = summary_of(
        tmp_path,
        [
            row("a", "ground-truth", "1", 0.0),
            row("a", "ground-truth", "1", None, sample=None, min_ade=0.5),
            row("a", "other", "1", 3.0),
            row("a", "other", "1", None, sample=None, min_ade=2.0),
        ],
    )
    movers = at(summary, "other", "none", "movers on their way")
    assert summary.statistics["ade"].num_scenes[movers] == 1
    assert summary.statistics["min_ade"].mean.value[movers] == 2.0
    assert summary.statistics["min_ade"].difference.value[movers] == 1.5
    assert summary.num_agents[movers] == 1


def test_perturbed_roads_together(tmp_path):
    deviations = {"smooth-turn": (1.0, 3.0), "ripple-road": (5.0,)}
    rows = [
        row(
            scene,
            "other",
            "1",
            None,
            warp=warp,
            power=3.0 if warp == "smooth-turn" else 6.0,
            lateral_deviation_final=value,
        )
        for warp, values in deviations.items()
        for scene, value in zip("ab", values, strict=False)
    ]
    plain = row("a", "other", "1", None, lateral_deviation_final=50.0)
    summary = summary_of(tmp_path, [*rows, plain], ROADS)
    assert summary.roads == (*ROADS, "perturbed")
    final = summary.statistics["lateral_deviation_final"]
    found = at(summary, "other", "perturbed", "movers")
    assert final.mean.value[found] == 3.0
    assert summary.median_final.value[found] == 3.0
    assert summary.statistics[FAR_FROM_LANE].mean.value[found] == pytest.approx(2 / 3)
    assert (summary.num_agents[found], summary.num_scenes[found]) == (3, 2)
    one = at(summary, "other", "smooth-turn:3", "movers")
    assert (final.mean.value[one], summary.median_final.value[one]) == (2.0, 2.0)


def test_no_rows_at_all(tmp_path):
    summary = summary_of(tmp_path, [])
    assert not summary.num_agents.any()
    assert np.isnan(summary.statistics["ade"].mean.value).all()


def test_equal_ids_in_other_splits_are_other_scenes(tmp_path):
    rows = [row("a", "other", "1", 1.0), row("a", "other", "1", 2.0, split="val")]
    summary = summary_of(tmp_path, rows)
    movers = at(summary, "other", "none", "movers")
    assert (summary.num_scenes[movers], summary.num_agents[movers]) == (2, 2)
