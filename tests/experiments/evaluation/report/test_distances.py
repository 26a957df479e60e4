import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.metrics.distribution_distance import (
    discrepancy_kernel,
    histogram_of,
    mean_discrepancy,
)
from pd_editor.experiments.evaluation.evaluation_task import DRIVING, EvaluationTask
from pd_editor.experiments.evaluation.report.realism import (
    JOINT_METRICS,
    distance_tables,
)

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


def states_file(tmp_path, shift: float):
    """Six scenes with ten movers each, whose generated speeds are shifted."""
    random = np.random.default_rng(0)
    log = random.normal(size=(60, len(JOINT_METRICS)))
    rows = [
        {
            "scenario_id": f"scene-{index // 10}",
            "split": "val",
            "method": method,
            "sample": 0,
            "agent_id": f"{index % 10}",
            "warp": "none",
            "group": "movers",
            "recorded": 1.0,
            **dict(zip(JOINT_METRICS, values, strict=True)),
        }
        for method, off in (("ground-truth", 0.0), ("same", 0.0), ("faster", shift))
        for index, values in enumerate(np.abs(log) + off)
    ]
    path = tmp_path / "rows.parquet"
    pq.write_table(pa.Table.from_pylist(rows), path)
    return path


def test_the_mean_discrepancy_of_equal_states_is_zero_and_grows(tmp_path):
    found = []
    for shift in (0.5, 2.0):
        path = states_file(tmp_path, shift)
        (table,) = distance_tables(
            path, ["ground-truth", "same", "faster"], DRIVING, ["val"]
        )
        name = table.rows[-1][0]
        assert all(metric in name for metric in JOINT_METRICS)
        cell = cells(table, name, "Gaussian kernel")
        assert float(cell["same"]) == 0.0
        assert 0 < float(cell["noise floor"]) < float(cell["faster"])
        found.append(float(cell["faster"]))
    assert found[0] < found[1] < np.sqrt(2)


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(2, 9))
def test_the_mean_discrepancy_is_that_of_the_definition(seed, num_one, num_two):
    random = np.random.default_rng(seed)
    one, two = random.normal(size=(num_one, 3)), random.normal(1, 2, size=(num_two, 3))
    kernel = discrepancy_kernel(one, two)
    share = np.repeat([1 / num_one, -1 / num_two], [num_one, num_two])
    own, other = kernel[:num_one, :num_one], kernel[num_one:, num_one:]
    squared = own.mean() + other.mean() - 2 * kernel[:num_one, num_one:].mean()
    (found,) = mean_discrepancy(kernel, share[None])
    assert found**2 == pytest.approx(max(squared, 0.0), abs=1e-9)
    moved = discrepancy_kernel(one * [1, 10, 0.1] + 5, two * [1, 10, 0.1] + 5)
    np.testing.assert_allclose(moved, kernel, atol=1e-9)
