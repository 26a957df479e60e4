"""Values of the paper's tables, from rows: means and distances over scenes and seeds."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.distribution_distance import (
    Histogram,
    jensen_shannon_divergences,
)
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.experiments.evaluation.summary import (
    COVERAGE,
    mean_over_scenes,
    scene_weights,
)
from reproduction.mean_discrepancy import maximum_mean_discrepancy
from reproduction.plans import Entry, Mode

_KEYS: Final = ("scenario_id", "split", "method", "warp", "sample", "recorded")
_MOTOR_VEHICLES: Final = "movers"


@dataclass(frozen=True, kw_only=True)
class TableLine:
    """A line of a table: a system, unguided or guided."""

    system: str
    mode: Mode


@dataclass(frozen=True, kw_only=True)
class MeasuredValue:
    """A value with its interval over scenes and seeds; NaN if there is none."""

    value: float
    low: float = np.nan
    high: float = np.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class RowTable:
    """Rows of one evaluation: motor vehicles of some splits."""

    entries: tuple[Entry, ...]
    scene: Int[np.ndarray, "R"]
    entry: Int[np.ndarray, "R"]
    is_plain: Bool[np.ndarray, "R"]
    is_sample: Bool[np.ndarray, "R"]
    """False for rows about all samples of an agent together."""
    is_whole: Bool[np.ndarray, "R"]
    """Whether the log has the agent at all later steps."""
    columns: Mapping[str, Float[np.ndarray, "R"] | list[list[float] | None]]
    """Values of each metric, NaN where there is none; lists of metrics with several."""
    num_scenes: int
    seed: int

    @classmethod
    def of(
        cls,
        path: Path,
        entries: Sequence[Entry],
        metrics: Collection[str],
        splits: Sequence[str],
        seed: int,
    ) -> "RowTable":
        """Read some metrics of a file of rows."""
        table = pq.read_table(
            path,
            columns=[*_KEYS, *metrics],
            filters=(pc.field("group") == _MOTOR_VEHICLES)
            & pc.field("split").isin(list(splits)),
        )
        names = {one.method.name: row for row, one in enumerate(entries)}
        scenes = [
            f"{split}/{scene}"
            for split, scene in zip(
                table["split"].to_pylist(),
                table["scenario_id"].to_pylist(),
                strict=True,
            )
        ]
        number = {name: row for row, name in enumerate(dict.fromkeys(scenes))}
        return cls(
            entries=tuple(entries),
            scene=np.array([number[name] for name in scenes], int),
            entry=np.array([names[one] for one in table["method"].to_pylist()], int),
            is_plain=np.array(
                [one == "none" for one in table["warp"].to_pylist()], bool
            ),
            is_sample=np.array(table["sample"].is_valid(), bool),
            is_whole=np.array(table["recorded"].to_pylist(), float) == 1.0,
            columns={name: _column(table[name]) for name in metrics},
            num_scenes=len(number),
            seed=seed,
        )

    @cached_property
    def lines(self) -> tuple[TableLine, ...]:
        """The lines of tables, without duplicates, in the order of the entries."""
        lines = (TableLine(system=one.system, mode=one.mode) for one in self.entries)
        return tuple(dict.fromkeys(lines))

    @cached_property
    def _scene_weights(self) -> Float[np.ndarray, "K N"]:
        return scene_weights(self.num_scenes, self.seed)

    def rows(self, line: TableLine, *, plain: bool) -> list[Bool[np.ndarray, "R"]]:
        """Rows of a line on plain or on warped roads, for each of its seeds."""
        return [
            (self.entry == row) & (self.is_plain == plain)
            for row, one in enumerate(self.entries)
            if (one.system, one.mode) == (line.system, line.mode)
        ]

    def mean(self, metric: str, line: TableLine, *, plain: bool) -> MeasuredValue:
        """Mean of a metric over agents, samples and seeds."""
        sums, counts = self._of_scenes(metric, line, plain=plain)
        if not np.any(counts):
            return MeasuredValue(value=np.nan)
        found = mean_over_scenes(
            np.concatenate(sums)[None],
            np.concatenate(counts)[None],
            self._weights(len(sums)),
        )
        return MeasuredValue(
            value=float(found.value[0]),
            low=float(found.low[0]),
            high=float(found.high[0]),
        )

    def difference(
        self, metric: str, first: TableLine, second: TableLine, *, plain: bool
    ) -> MeasuredValue:
        """Difference of two means; scenes are resampled together, trainings apart."""
        means, resampled = [], []
        for key, line in enumerate((first, second)):
            sums, counts = self._of_scenes(metric, line, plain=plain)
            if not np.any(counts):
                return MeasuredValue(value=np.nan)
            means.append(np.sum(sums) / np.sum(counts))
            weights = self._weights(len(sums), key)
            with np.errstate(invalid="ignore"):
                resampled.append(
                    (weights @ np.concatenate(sums))
                    / (weights @ np.concatenate(counts))
                )
        low, high = _interval(resampled[0] - resampled[1])
        return MeasuredValue(value=float(means[0] - means[1]), low=low, high=high)

    def _of_scenes(
        self, metric: str, line: TableLine, *, plain: bool
    ) -> tuple[list[Float[np.ndarray, "N"]], list[Float[np.ndarray, "N"]]]:
        """Sums and counts of a metric in each scene, for each seed of a line."""
        values = self.columns[metric]
        assert isinstance(values, np.ndarray)
        known = np.isfinite(values)
        sums, counts = [], []
        for rows in self.rows(line, plain=plain):
            used = rows & known
            scene = self.scene[used]
            total = np.bincount(scene, values[used], self.num_scenes)
            sums.append(total.astype(float))
            counts.append(np.bincount(scene, minlength=self.num_scenes).astype(float))
        return sums, counts

    def distance(self, histogram: Histogram, line: TableLine) -> MeasuredValue:
        """Jensen-Shannon distance to the log on plain roads.

        For the log itself: the mean distance between the log and resampled scenes of it,
        which no system can expect to beat.
        """
        log = self._counts(histogram, TableLine(system=GROUND_TRUTH, mode=""))[0]
        weights = self._scene_weights
        if line.system == GROUND_TRUTH:
            floor = _distances(
                weights @ log, np.tile(log.sum(axis=0), (len(weights), 1))
            )
            return MeasuredValue(value=float(np.nanmean(floor)))
        counts = self._counts(histogram, line)
        if not np.any(counts):
            return MeasuredValue(value=np.nan)
        whole = np.sum(counts, axis=(0, 1))
        value = _distances(whole[None], log.sum(axis=0)[None])[0]
        resampled = _distances(
            self._weights(len(counts)) @ np.concatenate(counts), weights @ log
        )
        # Resampled histograms are rougher, so that their distances are larger.
        low, high = _interval(resampled - np.nanmedian(resampled) + value)
        return MeasuredValue(value=float(value), low=max(low, 0.0), high=high)

    def discrepancy(
        self, metrics: Sequence[str], line: TableLine, *, plain: bool
    ) -> MeasuredValue:
        """Squared maximum mean discrepancy to the log, of agents as vectors of metrics.

        Each metric is in units of the log's standard deviation.
        """
        log = self._points(
            metrics, TableLine(system=GROUND_TRUTH, mode=""), plain=plain
        )
        if line.system == GROUND_TRUTH or len(log) < 2:
            return MeasuredValue(value=np.nan)
        scale = np.maximum(log.std(axis=0), 1e-9)
        found = maximum_mean_discrepancy(
            self._points(metrics, line, plain=plain) / scale, log / scale
        )
        return MeasuredValue(value=found.squared if found.is_valid else np.nan)

    def _points(
        self, metrics: Sequence[str], line: TableLine, *, plain: bool
    ) -> Float[np.ndarray, "N D"]:
        used = np.any(self.rows(line, plain=plain), axis=0) & self.is_sample
        parts = [
            np.array([_mean_of(column[row]) for row in np.flatnonzero(used)], float)
            for column in (self.columns[name] for name in metrics)
        ]
        points = np.stack(parts, axis=1) if used.any() else np.zeros((0, len(metrics)))
        return points[np.isfinite(points).all(axis=1)]

    def _counts(
        self, histogram: Histogram, line: TableLine
    ) -> list[Float[np.ndarray, "N B"]]:
        """Histogram of each scene on plain roads, for each seed of a line."""
        column = self.columns[histogram.metric]
        found = []
        for rows in self.rows(line, plain=True):
            values: list[list[float]] = [[] for _ in range(self.num_scenes)]
            for row in np.flatnonzero(rows & self.is_sample):
                values[self.scene[row]].extend(_numbers(column[row]))
            found.append(np.stack([histogram.counts(np.array(v)) for v in values]))
        return found

    def _weights(self, num_seeds: int, key: int = 0) -> Float[np.ndarray, "K NS"]:
        """Count of each scene of each seed in each resample; seeds come first."""
        random = np.random.default_rng([self.seed, num_seeds, key])
        share = np.full(num_seeds, 1 / num_seeds)
        scenes = self._scene_weights
        of_seeds = random.multinomial(num_seeds, share, len(scenes)).astype(float)
        return (of_seeds[:, :, None] * scenes[:, None]).reshape(len(scenes), -1)


def _interval(resampled: Float[np.ndarray, "K"]) -> tuple[float, float]:
    """Percentile interval; NaN if no resample has a value."""
    known = resampled[np.isfinite(resampled)]
    if not len(known):
        return np.nan, np.nan
    low, high = np.quantile(known, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return float(low), float(high)


def _distances(
    first: Float[np.ndarray, "K B"], second: Float[np.ndarray, "K B"]
) -> Float[np.ndarray, "K"]:
    """Jensen-Shannon distance of pairs of histograms; NaN if one is empty."""
    return np.sqrt(jensen_shannon_divergences(first, second))


def _column(column: pa.ChunkedArray) -> "Float[np.ndarray, 'R'] | list[Any]":
    if pa.types.is_list(column.type):
        return column.to_pylist()
    return column.to_numpy().astype(float)


def _numbers(value: float | list[float] | None) -> list[float]:
    if isinstance(value, list):
        return value
    return [] if value is None or np.isnan(value) else [float(value)]


def _mean_of(value: float | list[float] | None) -> float:
    numbers = _numbers(value)
    return sum(numbers) / len(numbers) if numbers else np.nan
