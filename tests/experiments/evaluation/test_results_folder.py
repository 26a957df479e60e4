from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from pd_editor.experiments.evaluation.method import TrialItem
from pd_editor.experiments.evaluation.scene_rows import (
    ROW_SCHEMA,
    RowsFolder,
    SceneRows,
)
from tests.experiments.synthesis.serial_engine import SerialEngine

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


def test_all_rows_are_written_in_one_step(tmp_path, monkeypatch):
    """A kill, or a full disk, left the beginning of the file under its name."""
    folder = opened(tmp_path)
    folder.rows_path.write_bytes(b"of before")

    def interrupted(key: str, *, with_rows: bool = True) -> None:
        if with_rows:
            raise KeyboardInterrupt

    monkeypatch.setattr(folder, "load", interrupted)
    item = Mock(spec=TrialItem)
    with pytest.raises(KeyboardInterrupt):
        folder.run(lambda _: EMPTY, {"a/none": item}, SerialEngine())
    assert folder.rows_path.read_bytes() == b"of before"
