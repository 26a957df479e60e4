"""Likelihoods of the log among a method's samples, and their meta-metric."""

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
        filters=(pc.field("warp") == PLAIN)
        & (pc.field("method") == method)
        & pc.field("split").isin(list(splits))
        & pc.field("sample").is_null(),
    )
    means: pa.Table = table.group_by(["split", "scenario_id"]).aggregate(
        [(name, "mean") for name in LIKELIHOODS]
    )
    values = [means[f"{name}_mean"].to_numpy() for name in LIKELIHOODS]
    found = np.stack(values, axis=-1).astype(float)
    return found[np.isfinite(found).all(axis=1)]
