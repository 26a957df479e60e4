"""The scene test finds what differs, and only that."""

import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.experiments.evaluation.report.realism import scene_test_tables
from pd_editor.experiments.evaluation.scene_rows import ROW_SCHEMA
from scene_test import FEATURES, Surroundings, scene_test

NUM_SCENES, NUM_VEHICLES = 6, 30


def vehicles(seed: int, shift: float = 0.0) -> Surroundings:
    random = np.random.default_rng(seed)
    features = random.normal(size=(NUM_SCENES * NUM_VEHICLES, len(FEATURES)))
    features[:, FEATURES.index("lane angle")] += shift
    scene = np.repeat([f"scene-{k}" for k in range(NUM_SCENES)], NUM_VEHICLES)
    return Surroundings(features=features, scene=scene)


def test_equal_distributions_cannot_be_told_apart():
    found = scene_test(vehicles(1), vehicles(2))
    assert found is not None
    assert abs(found.auc - 0.5) < 0.07


def test_a_feature_that_differs_is_named():
    found = scene_test(vehicles(1), vehicles(2, shift=2.0))
    assert found is not None
    assert found.auc > 0.85
    assert found.telling[0][0] == "lane angle"


def test_one_scene_or_one_side_is_no_test():
    one = vehicles(1)
    same = Surroundings(features=one.features, scene=np.repeat("a", len(one.scene)))
    assert scene_test(same, same) is None
    none = Surroundings(features=one.features[:0], scene=one.scene[:0])
    assert scene_test(one, none) is None


@pytest.fixture
def rows(tmp_path):
    lines = []
    for method, found in (("ground-truth", vehicles(1)), ("model", vehicles(2, 2.0))):
        for scene, values in zip(found.scene, found.features, strict=True):
            lines.append(
                dict.fromkeys(ROW_SCHEMA.names)
                | {
                    "scenario_id": str(scene),
                    "split": "val",
                    "method": method,
                    "warp": "none",
                    "sample": 0,
                    "surroundings": values.tolist(),
                }
            )
    lines.append(lines[-1] | {"split": "train", "surroundings": [9.0] * len(FEATURES)})
    lines.append(lines[0] | {"surroundings": []})
    path = tmp_path / "rows.parquet"
    pq.write_table(pa.Table.from_pylist(lines, ROW_SCHEMA), path)
    return path


def test_the_table_is_of_the_asked_splits(rows):
    (table,) = scene_test_tables(rows, ["ground-truth", "model"], ["val"])
    ((name, auc, words),) = table.rows
    assert name == "model"
    assert float(auc.split()[0]) > 0.85
    assert words.startswith("lane angle")
    assert table.note.startswith(f"{NUM_SCENES * NUM_VEHICLES} recorded vehicles")


def test_without_scikit_learn_the_table_says_what_to_install(rows, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    (table,) = scene_test_tables(rows, ["ground-truth", "model"], ["val"])
    assert "pd-editor[evaluate]" in table.rows[0][2]
