"""Tables of distances between each method's distributions and the log's."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
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
from pd_editor.analysis.metrics.values import METRICS, MetricValues, measured
from pd_editor.experiments.evaluation.evaluation_task import EvaluationTask
from pd_editor.experiments.evaluation.reference_methods import GROUND_TRUTH
from pd_editor.experiments.evaluation.scene_bootstrap import scene_weights
from pd_editor.experiments.report import ReportTable

PLAIN: Final = "none"
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
_MOST_AGENTS: Final = 2000
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
        rows = rows[:: len(rows) // _MOST_AGENTS + 1]
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
