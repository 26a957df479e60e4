import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.analysis.metrics.distributions.distribution_distance import histogram_of
from pd_editor.experiments.evaluation.evaluation_task import DRIVING, EvaluationTask
from pd_editor.experiments.evaluation.report.distances import distance_tables

LN2_ROOT = np.sqrt(np.log(2))


def rows_file(tmp_path, lengths: dict[str, list[float]], recorded=(1.0, 1.0, 1.0, 1.0)):
    """Two scenes with two movers each; path lengths by method."""
    rows = [
        {
            "scenario_id": f"scene-{index // 2}",
            "split": "train",
            "method": method,
            "sample": 0,
            "agent_id": f"{index % 2}",
            "warp": "none",
            "group": "movers",
            "recorded": recorded[index],
            "path_length": length,
            "speed": 5.0,
            "local_density": [4.0, 9.0],
        }
        for method, values in lengths.items()
        for index, length in enumerate(values)
    ]
    path = tmp_path / "rows.parquet"
    pq.write_table(pa.Table.from_pylist(rows), path)
    return path


def cells(table, metric: str, bins: str) -> dict[str, str]:
    (row,) = (r for r in table.rows if r[0] == metric and r[2] == bins)
    return dict(zip(table.header, row, strict=True))


def test_equal_is_zero_and_disjoint_is_the_root_of_ln_2(tmp_path):
    log = [10.0, 20.0, 30.0, 40.0]
    path = rows_file(
        tmp_path,
        {"ground-truth": log, "same": log, "far": [100.0, 101.0, 102.0, 103.0]},
    )
    (table,) = distance_tables(
        path, ["ground-truth", "same", "far"], DRIVING, ["train"]
    )
    found = cells(table, "path_length", "ours")
    assert float(found["same"]) == 0.0
    assert float(found["far"]) == pytest.approx(LN2_ROOT, abs=1e-3)
    assert 0 < float(found["noise floor"]) < LN2_ROOT
    assert float(cells(table, "local_density", "paper")["far"]) == 0.0


def test_agents_that_leave_the_recording_early_do_not_count(tmp_path):
    path = rows_file(
        tmp_path,
        {
            "ground-truth": [10.0, 20.0, 30.0, 1.0],
            "same-else": [10.0, 20.0, 30.0, 100.0],
        },
        recorded=(1.0, 1.0, 1.0, 0.4),
    )
    (table,) = distance_tables(path, ["ground-truth", "same-else"], DRIVING, ["train"])
    assert float(cells(table, "path_length", "ours")["same-else"]) == 0.0
    assert table.note.startswith("3 agents")


def test_drawn_states_are_compared_with_all_of_the_log(tmp_path):
    """A way that the log has not to the end does not count; its state does."""
    path = rows_file(
        tmp_path,
        {
            "ground-truth": [10.0, 20.0, 30.0, 1.0],
            "drawn": [10.0, 20.0, 30.0, 30.0],
        },
        recorded=(1.0, 1.0, 1.0, 0.4),
    )
    rows = pq.read_table(path).to_pylist()
    for row in rows:
        row["speed"] = 9.0 if row["recorded"] < 1 else 5.0
        row["recorded"] = 1.0 if row["method"] == "drawn" else row["recorded"]
    pq.write_table(pa.Table.from_pylist(rows), path)
    (table,) = distance_tables(
        path, ["ground-truth", "drawn"], EvaluationTask(states="sampled"), ["train"]
    )
    assert float(cells(table, "speed", "ours")["drawn"]) == 0.0
    lengths = histogram_of("path_length", "ours")
    far = lengths.distance(np.array([10.0, 20, 30]), np.array([10.0, 20, 30, 30]))
    assert far.root > 0.05
    assert float(cells(table, "path_length", "ours")["drawn"]) == pytest.approx(
        far.root, abs=1e-3
    )
    assert table.note.startswith(
        "4 agents of the log at the current step; of their trajectories, 3"
    )


def test_without_a_log_there_is_nothing_to_compare_with(tmp_path):
    path = rows_file(tmp_path, {"same": [10.0, 20.0, 30.0, 40.0]})
    assert distance_tables(path, ["same"], DRIVING, ["train"]) == []
