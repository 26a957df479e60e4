"""The table of likelihoods: means over scenes, between the floor and the log."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.analysis.metrics.likelihoods import LIKELIHOODS
from pd_editor.experiments.evaluation.report.realism import realism_tables
from pd_editor.experiments.evaluation.scene_rows import ROW_SCHEMA

OF_METHOD = {"ground-truth": 0.9, "constant-velocity": 0.4, "model": 0.65}
METHODS = list(OF_METHOD)


def rows(path, *, sample=None):
    """Two scenes of three agents, each feature of a method equally likely on average."""
    lines = [
        dict.fromkeys(ROW_SCHEMA.names)
        | {
            "scenario_id": f"scene-{scene}",
            "split": "val",
            "method": method,
            "warp": "none",
            "power": 0.0,
            "sample": sample,
            "agent_id": str(agent),
        }
        | dict.fromkeys(LIKELIHOODS, float(np.log(share) + 0.2 * (agent - 1)))
        for method, share in OF_METHOD.items()
        for scene in range(2)
        for agent in range(3)
    ]
    pq.write_table(pa.Table.from_pylist(lines, ROW_SCHEMA), path)
    return path


def test_methods_stand_between_the_floor_and_the_log(tmp_path):
    (table,) = realism_tables(rows(tmp_path / "rows"), METHODS, ["val"], 0)
    assert table.header[-1] == "from constant-velocity to the log"
    told = {row[0]: row for row in table.rows}
    assert list(told) == METHODS
    for method, share in OF_METHOD.items():
        assert {one.split()[0] for one in told[method][1:-1]} == {f"{share:.2f}"}
    assert [told[one][-1] for one in METHODS] == ["100%", "0%", "50%"]


def test_without_the_floor_there_is_no_place_between(tmp_path):
    (table,) = realism_tables(rows(tmp_path / "rows"), ["model"], ["val"], 0)
    assert table.rows[0][-1] == "-"


def test_rows_of_single_samples_make_no_table(tmp_path):
    assert realism_tables(rows(tmp_path / "rows", sample=0), METHODS, ["val"], 0) == []
