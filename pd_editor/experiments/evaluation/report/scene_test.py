"""The scene test of the methods of an evaluation."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pd_editor.experiments.evaluation.reference_methods import GROUND_TRUTH
from pd_editor.experiments.evaluation.road_condition import PLAIN
from pd_editor.experiments.report import ReportTable
from scene_test import FEATURES, SceneTest, Surroundings, scene_test

_EXTRA: Final = "install pd-editor[evaluate] for it (scikit-learn)"


def scene_test_tables(
    rows_file: Path, methods: Sequence[str], splits: Sequence[str]
) -> list[ReportTable]:
    """Tables with one row per method: AUC on original roads, and its main features."""
    recorded = _surroundings(rows_file, GROUND_TRUTH, splits)
    rows = []
    for name in methods:
        if name == GROUND_TRUTH:
            continue
        try:
            found = scene_test(recorded, _surroundings(rows_file, name, splits))
        except ImportError:
            rows.append((name, "-", _EXTRA))
            continue
        if found is not None:
            rows.append((name, *str(found).split("; ")))
    if not rows:
        return []
    return [
        ReportTable(
            title="Scene test, vehicles on plain roads",
            header=(
                "method",
                "AUC [95 % of resampled scenes]",
                "features that tell most, each alone",
            ),
            rows=tuple(rows),
            note=f"{len(recorded.features)} recorded vehicles. AUC of a classifier, "
            "cross-validated by scene, that tells recorded from generated vehicles by "
            "what is around them; 0.5: it cannot. States are jittered on both sides.",
        )
    ]


def scene_test_of(
    rows_file: Path, method: str, splits: Sequence[str]
) -> SceneTest | None:
    """Scene test of one method; None without scikit-learn or with too few scenes."""
    recorded, generated = (
        _surroundings(rows_file, name, splits) for name in (GROUND_TRUTH, method)
    )
    try:
        return scene_test(recorded, generated)
    except ImportError:
        return None


def _surroundings(rows_file: Path, method: str, splits: Sequence[str]) -> Surroundings:
    table = pq.read_table(
        rows_file,
        columns=["scenario_id", "sample", "surroundings"],
        filters=(pc.field("warp") == PLAIN)
        & (pc.field("method") == method)
        & pc.field("split").isin(list(splits)),
    )
    kept = [
        (scene, values)
        for scene, values in zip(
            table["scenario_id"].to_pylist(),
            table["surroundings"].to_pylist(),
            strict=True,
        )
        if values
    ]
    return Surroundings(
        features=np.array([values for _, values in kept], float).reshape(
            -1, len(FEATURES)
        ),
        scene=np.array([scene for scene, _ in kept], str),
    )
