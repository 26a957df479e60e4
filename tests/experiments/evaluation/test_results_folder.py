from dataclasses import replace
from pathlib import Path

from pd_editor.experiments.evaluation.scene_rows import (
    ROW_SCHEMA,
    RowsFolder,
    SceneRows,
)

EMPTY = SceneRows(table=ROW_SCHEMA.empty_table(), model_sha256={"m": "1"})


def opened(path: Path, *, resume: bool = False) -> RowsFolder:
    rows = "rows.parquet", ROW_SCHEMA
    return RowsFolder(path, {"seed": 0}, rows, work="evaluation", resume=resume)


def test_a_finished_scene_comes_back(tmp_path):
    folder = opened(tmp_path / "out")
    folder.store("train/aaa/none", EMPTY)
    failed = replace(EMPTY, failures={"m": "No."}, has_future=False)
    folder.store("train/bbb/none", failed)
    again = opened(tmp_path / "out", resume=True)
    keys = {"train/aaa/none": 0, "train/bbb/none": 0, "train/ccc/none": 0}
    assert again.finished(keys) == {"train/aaa/none"}
    found = again.load("train/bbb/none")
    assert found is not None
    assert (found.failures, found.has_future) == ({"m": "No."}, False)
    assert found.model_sha256 == {"m": "1"}
    assert found.table.equals(EMPTY.table)


def test_a_damaged_file_counts_as_not_finished(tmp_path):
    folder = opened(tmp_path)
    folder.store("a/none", EMPTY)
    path = tmp_path / "finished" / "a" / "none.parquet"
    path.write_bytes(path.read_bytes()[:-9])
    assert folder.load("a/none") is None
    assert folder.finished({"a/none": 0}) == frozenset()
