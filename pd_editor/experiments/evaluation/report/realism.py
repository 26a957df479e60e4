"""How real samples are: likelihoods of the log, scene test, distances of distributions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.distribution_distance import (
    HISTOGRAMS,
    NUM_RESAMPLES,
    Histogram,
    discrepancy_kernel,
    mean_discrepancy,
    noise_floor,
)
from pd_editor.analysis.metrics.likelihoods import LIKELIHOODS, NUM_SAMPLES, meta_metric
from pd_editor.analysis.metrics.values import METRICS, MetricValues, measured
from pd_editor.experiments.evaluation.evaluation_task import PLAIN, EvaluationTask
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.experiments.evaluation.summary import (
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


STATE_METRICS: Final = (
    "nearest_distance",
    "local_density",
    "nearest_edge",
    "nearest_edge_angle",
    "speed",
)
"""Metrics at the current step, which do not depend on when an agent leaves."""
JOINT_METRICS: Final = (
    *(name for name in STATE_METRICS if name != "local_density"),
    "length",
    "width",
)
"""Features of the maximum mean discrepancy: those of Scenario Dreamer."""
_KEYS: Final = ("scenario_id", "method", "sample", "agent_id")


class _Rows:
    """Values of motor vehicles on original roads, one row per sample.

    Trajectories count only if the log has them to the end; where states are sampled,
    this applies to the log's own agents.
    """

    def __init__(
        self, rows_file: Path, task: EvaluationTask, splits: Sequence[str]
    ) -> None:
        schema = pq.read_schema(rows_file)
        self.histograms = [h for h in HISTOGRAMS if h.metric in schema.names]
        metrics = dict.fromkeys(histogram.metric for histogram in self.histograms)
        table = pq.read_table(
            rows_file,
            columns=[*_KEYS, "recorded", *metrics],
            filters=(pc.field("warp") == PLAIN)
            & (pc.field("group") == "movers")
            & pc.field("split").isin(list(splits)),
        )
        table = table.filter(table["sample"].is_valid())
        self.method = np.array(table["method"].to_pylist(), object)
        self.scene = np.array(table["scenario_id"].to_pylist(), object)
        agent = np.array(table["agent_id"].to_pylist(), object)
        whole = np.array(table["recorded"].to_pylist(), float) == 1.0
        # Agents that left the recording early have a shorter path in the log only.
        key = [f"{scene}/{name}" for scene, name in zip(self.scene, agent, strict=True)]
        self.agent = np.array(key, object)
        self.is_logged = np.asarray(self.method == GROUND_TRUTH, bool)
        if task.samples_states:
            self.counts = whole | ~self.is_logged
        else:
            logged = set(self.agent[whole & self.is_logged])
            self.counts = np.array([name in logged for name in key], bool)
        self._states_count = self.counts | task.samples_states
        self.columns = {
            name: [_numbers(value) for value in table[name].to_pylist()]
            for name in metrics
        }

    def _parts(
        self, metric: str, which: Bool[np.ndarray, "R"]
    ) -> list[Float[np.ndarray, "_"]]:
        is_state = metric in STATE_METRICS or metric in JOINT_METRICS
        counts = self._states_count if is_state else self.counts
        column = self.columns[metric]
        return [column[row] for row in np.flatnonzero(which & counts)]

    def values(
        self, metric: str, which: Bool[np.ndarray, "R"]
    ) -> Float[np.ndarray, "N"]:
        """All values of a metric in some rows, flattened."""
        return np.concatenate([np.zeros(0), *self._parts(metric, which)])

    def states(
        self, which: Bool[np.ndarray, "R"]
    ) -> tuple[Float[np.ndarray, "N F"], np.ndarray]:
        """``JOINT_METRICS`` of evenly chosen agents that have all, and their scenes."""
        rows = np.flatnonzero(which & self._states_count)
        rows = rows[:: len(rows) // 2000 + 1]
        found = [
            np.concatenate([self.columns[name][row] for name in JOINT_METRICS])
            for row in rows
        ]
        is_whole = [len(one) == len(JOINT_METRICS) for one in found]
        values = [
            np.abs(one) for one, keep in zip(found, is_whole, strict=True) if keep
        ]
        return np.reshape(values, (-1, len(JOINT_METRICS))), self.scene[rows][is_whole]

    def scenes(self, metric: str) -> list[MetricValues]:
        """Values of the log, one entry per scene."""
        scenes = (
            self._parts(metric, self.is_logged & (self.scene == scene))
            for scene in dict.fromkeys(self.scene[self.is_logged])
        )
        return [_padded(metric, parts) for parts in scenes if parts]


def distance_tables(
    rows_file: Path, methods: Sequence[str], task: EvaluationTask, splits: Sequence[str]
) -> list[ReportTable]:
    """Jensen-Shannon distances to the log, for motor vehicles of some splits."""
    rows = _Rows(rows_file, task, splits)
    others = [name for name in methods if name != GROUND_TRUTH]
    is_logged = rows.is_logged
    num_agents = len(set(rows.agent[rows.counts & is_logged]))
    if not others or not num_agents:
        return []
    lines = []
    for histogram in rows.histograms:
        log = rows.values(histogram.metric, is_logged)
        floor = _floor(rows, histogram)
        cells = [
            _cell(histogram, rows.values(histogram.metric, rows.method == name), log)
            for name in others
        ]
        unit = METRICS[histogram.metric].unit
        lines.append((histogram.metric, unit, histogram.source, floor, *cells))
    lines += _joint_lines(rows, others)
    whole = f"{num_agents} agents that the log has to the end"
    if task.samples_states:
        present = len(set(rows.agent[is_logged]))
        whole = f"{present} agents of the log at the current step; of their trajectories, {whole}"
    return [
        ReportTable(
            title="Movers, plain roads: distance of distributions",
            header=("metric", "unit", "bins", "noise floor", *others),
            rows=tuple(lines),
            note=f"{whole}. The noise floor is "
            f"the mean over {NUM_RESAMPLES} resamples of recorded scenes with as many agents. "
            "Metrics together: maximum mean discrepancy with a Gaussian kernel.",
        )
    ]


def _joint_lines(rows: _Rows, others: Sequence[str]) -> list[tuple[str, ...]]:
    """Maximum mean discrepancy of the states to the log's, if they are there."""
    if not set(JOINT_METRICS) <= rows.columns.keys():
        return []
    log, scene = rows.states(rows.is_logged)
    if not len(log):
        return []
    cells = []
    for name in others:
        made, _ = rows.states(rows.method == name)
        share = np.repeat([1 / len(log), -1 / max(len(made), 1)], [len(log), len(made)])
        (found,) = mean_discrepancy(discrepancy_kernel(log, made), share[None])
        cells.append(f"{found:.3f}" if len(made) else "-")
    names, row = np.unique(scene.astype(str), return_inverse=True)
    weights = scene_weights(len(names), seed=0)[:NUM_RESAMPLES, row]
    apart = weights / weights.sum(axis=1, keepdims=True) - 1 / len(log)
    floor = mean_discrepancy(discrepancy_kernel(log, log[:0]), apart).mean()
    words = ", ".join(JOINT_METRICS)
    return [(f"{words} together", "-", "Gaussian kernel", f"{floor:.3f}", *cells)]


def _floor(rows: _Rows, histogram: Histogram) -> str:
    scenes = rows.scenes(histogram.metric)
    num_agents = sum(
        int(scene.is_valid.reshape(len(scene), -1).any(1).sum()) for scene in scenes
    )
    if not num_agents:
        return "-"
    floor = noise_floor(
        scenes,
        lambda one, two: histogram.distance(one, two).root,
        num_agents=num_agents,
    )
    return f"{floor:.3f}"


def _cell(
    histogram: Histogram, values: Float[np.ndarray, "N"], log: Float[np.ndarray, "M"]
) -> str:
    found = histogram.distance(values, log)
    return f"{found.root:.3f}" if found.is_valid else "-"


def _numbers(value: float | list[float] | None) -> Float[np.ndarray, "N"]:
    if value is None:
        return np.zeros(0)
    items = value if isinstance(value, list) else [value]
    return np.array([item for item in items if item is not None], float)


def _padded(metric: str, parts: list[np.ndarray]) -> MetricValues:
    width = max((len(part) for part in parts), default=0) or 1
    value = np.zeros((len(parts), width))
    is_valid = np.zeros((len(parts), width), bool)
    for row, part in enumerate(parts):
        value[row, : len(part)] = part
        is_valid[row, : len(part)] = True
    return measured(metric, value, is_valid)
