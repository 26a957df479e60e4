"""How real a method's samples are: likelihoods of the log among them, and the scene test."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Float

from pd_editor.analysis.metrics.likelihoods import LIKELIHOODS, NUM_SAMPLES, meta_metric
from pd_editor.experiments.evaluation.reference_methods import GROUND_TRUTH
from pd_editor.experiments.evaluation.road_condition import PLAIN
from pd_editor.experiments.evaluation.scene_bootstrap import (
    Estimate,
    mean_over_scenes,
    scene_weights,
)
from pd_editor.experiments.report import NONE, ReportTable
from scene_test import FEATURES, SceneTest, Surroundings, scene_test

FLOOR: Final = "constant-velocity"
"""Method whose meta-metric counts as 0 in the last column; that of the log is 1."""


def realism_tables(
    rows_file: Path, methods: Sequence[str], splits: Sequence[str], seed: int
) -> list[ReportTable]:
    """A table with one row per method, on plain roads; none without recorded states."""
    found = {name: _by_scene(rows_file, name, splits) for name in methods}
    means = {
        name: _means(values, seed) for name, values in found.items() if len(values)
    }
    if not means:
        return []
    least, most = (
        float(means[one].value[0]) if one in means else np.nan
        for one in (FLOOR, GROUND_TRUTH)
    )
    rows = []
    for name, mean in means.items():
        share = (float(mean.value[0]) - least) / (most - least)
        cells = [mean.cell((at,), "") for at in range(len(LIKELIHOODS) + 1)]
        rows.append((name, *cells, NONE if np.isnan(share) else f"{share:.0%}"))
    titles = [one.removeprefix("likelihood_of_") for one in LIKELIHOODS]
    words = [one.replace("_", " ") for one in titles]
    return [
        ReportTable(
            title="Likelihood of the log among samples, plain roads",
            header=("method", "meta-metric", *words, f"from {FLOOR} to the log"),
            rows=tuple(rows),
            note="As in Waymo's sim agents challenge, without traffic lights and over a "
            "shorter time, so that its numbers are not comparable. The log's row is the "
            f"most that can be reached. The challenge takes {NUM_SAMPLES} samples "
            f"(--samples {NUM_SAMPLES}); with fewer all methods but these of one sample "
            "seem worse.",
        )
    ]


def _plain(method: str, splits: Sequence[str]) -> pc.Expression:
    """Rows of a method on plain roads."""
    has_method = pc.field("method") == method
    return (
        has_method & (pc.field("warp") == PLAIN) & pc.field("split").isin(list(splits))
    )


def _means(log_likelihood: Float[np.ndarray, "N F"], seed: int) -> Estimate:
    """Means over scenes of the meta-metric and of each likelihood."""
    of = dict(zip(LIKELIHOODS, log_likelihood.T, strict=True))
    values = np.concatenate([meta_metric(of)[None], np.exp(log_likelihood.T)])
    weights = scene_weights(values.shape[1], seed)
    return mean_over_scenes(values, np.ones_like(values), weights)


def _by_scene(
    rows_file: Path, method: str, splits: Sequence[str]
) -> Float[np.ndarray, "N F"]:
    """Mean log-likelihoods of the agents of each scene that has all of them."""
    table = pq.read_table(
        rows_file,
        columns=["split", "scenario_id", *LIKELIHOODS],
        filters=_plain(method, splits) & pc.field("sample").is_null(),
    )
    means: pa.Table = table.group_by(["split", "scenario_id"]).aggregate(
        [(name, "mean") for name in LIKELIHOODS]
    )
    values = [means[f"{name}_mean"].to_numpy() for name in LIKELIHOODS]
    found = np.stack(values, axis=-1).astype(float)
    return found[np.isfinite(found).all(axis=1)]


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
            rows.append(
                (name, "-", "install pd-editor[evaluate] for it (scikit-learn)")
            )
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
        filters=_plain(method, splits),
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
