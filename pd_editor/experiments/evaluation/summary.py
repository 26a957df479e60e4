"""Summary statistics of rows: by method, road condition and group, and against the log."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from pd_editor.experiments.evaluation.evaluation_task import RoadCondition
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.experiments.evaluation.scene_rows import METRIC_COLUMNS
from pd_editor.experiments.report import NONE

NUM_RESAMPLES: Final = 1000
COVERAGE: Final = 0.95


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Means and intervals of many cells; NaN if a cell has fewer than two scenes."""

    value: Float[np.ndarray, "*cells"]
    low: Float[np.ndarray, "*cells"]
    high: Float[np.ndarray, "*cells"]

    def cell(
        self,
        at: tuple[int, ...],
        unit: str,
        *,
        signed: bool = False,
        with_interval: bool = True,
    ) -> str:
        """Text of a mean with its interval; shares in per cent."""
        scale = 100.0 if unit == "share" else 1.0
        numbers = [scale * float(one[at]) for one in (self.value, self.low, self.high)]
        if np.isnan(numbers[0]):
            return NONE
        digits = 1 if unit == "share" else 2
        texts = [f"{number:{'+' if signed else ''}.{digits}f}" for number in numbers]
        if not with_interval or np.isnan(numbers[1]):
            return texts[0]
        return f"{texts[0]} [{texts[1]}, {texts[2]}]"


def scene_weights(num_scenes: int, seed: int) -> Float[np.ndarray, "R N"]:
    """Count of each scene in each resample."""
    random = np.random.default_rng([seed, num_scenes])
    share = np.full(num_scenes, 1 / max(num_scenes, 1))
    return random.multinomial(num_scenes, share, NUM_RESAMPLES).astype(float)


def mean_over_scenes(
    sums: Float[np.ndarray, "*cells N"],
    counts: Float[np.ndarray, "*cells N"],
    weights: Float[np.ndarray, "R N"],
) -> Estimate:
    """Means of values, given their sums and counts in each of N scenes.

    All values have the same weight. Scenes are resampled, since agents of one scene are
    correlated. Resamples without a value are left out.
    """
    total = counts.sum(axis=-1)
    with np.errstate(invalid="ignore"):
        value = sums.sum(axis=-1) / total
        resampled = (sums @ weights.T) / (counts @ weights.T)
    resampled.sort(axis=-1)
    num_valid = np.isfinite(resampled).sum(axis=-1)
    known = (counts > 0).sum(axis=-1) > 1
    low, high = (
        np.where(known, _quantile(resampled, num_valid, at), np.nan)
        for at in ((1 - COVERAGE) / 2, (1 + COVERAGE) / 2)
    )
    return Estimate(value=value, low=low, high=high)


def _quantile(
    ordered: Float[np.ndarray, "*cells R"], count: np.ndarray, at: float
) -> Float[np.ndarray, "*cells"]:
    """Quantile of the first ``count`` numbers of each row, which are sorted."""
    place = at * np.maximum(count - 1, 0)
    below = np.floor(place).astype(int)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (
        np.take_along_axis(ordered, index[..., None], axis=-1)[..., 0]
        for index in (below, above)
    )
    return low + (place - below) * (high - low)


PERTURBED: Final = "perturbed"
"""Label of all warped roads together."""
FAR_M: Final = 2.0
FAR_FROM_LANE: Final = "lateral_deviation_final_over_2m"
"""Share of agents that end more than 2 m from their lanes."""
SUMMARY_GROUPS: Final = ("movers", "movers on their way", "pedestrians", "cyclists")
"""Groups of the summary. Half of the motor vehicles ("movers") are parked, and some drive
beyond the map; those that move and start on a lane are the most informative, so they are
a group of their own."""
_SEPARATE: Final = ("movers on their way", "other movers", "pedestrians", "cyclists")
_HELD: Final = ((0, 1), (0,), (2,), (3,))
"""Indices of the disjoint groups that form each group of the summary."""
_KEYS: Final = (
    "scenario_id",
    "split",
    "method",
    "warp",
    "power",
    "agent_id",
    "group",
    "under_way",
    "on_lane",
    "recorded",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Statistic:
    """Means of one metric for M methods, W road conditions and G groups."""

    mean: Estimate
    """Mean values [M W G]."""
    difference: Estimate
    """Mean differences to the log on the same agents, recorded to the end [M W G]."""
    num_scenes: Int[np.ndarray, "M W G"]
    num_pairs: Int[np.ndarray, "M W G"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """Statistics of all metrics."""

    methods: tuple[str, ...]
    roads: tuple[str, ...]
    """Labels of the road conditions; ``perturbed`` last if there is any warped one."""
    groups: tuple[str, ...]
    num_agents: Int[np.ndarray, "M W G"]
    """Number of distinct agents."""
    num_scenes: Int[np.ndarray, "M W G"]
    median_final: Estimate
    """Median final lateral deviations in metres [M W G], without intervals."""
    statistics: Mapping[str, Statistic]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """Assignment of each of R rows to a cell; -1 for none."""

    shape: tuple[int, int, int, int]
    """Numbers of methods, road conditions, disjoint groups and scenes."""
    method: Int[np.ndarray, "R"]
    road: Int[np.ndarray, "R"]
    group: Int[np.ndarray, "R"]
    scene: Int[np.ndarray, "R"]
    agent: Int[np.ndarray, "R"]
    """Index of the agent under its road condition, the same for all methods."""
    is_logged: Bool[np.ndarray, "R"]
    is_complete: Bool[np.ndarray, "R"]
    """Whether the log has the agent at all later steps."""
    roads: tuple[tuple[int, ...], ...]
    """Indices of the road conditions that form each one of the summary."""

    @cached_property
    def cell(self) -> Int[np.ndarray, "R"]:
        """Index of the cell of each row; -1 for rows that do not count."""
        codes = (self.method, self.road, self.group, self.scene)
        counts = np.min(codes, axis=0) >= 0
        cell = np.ravel_multi_index(
            tuple(np.where(counts, code, 0) for code in codes), self.shape
        )
        return np.where(counts, cell, -1)

    def sums(
        self, values: Float[np.ndarray, "R"], is_valid: Bool[np.ndarray, "R"]
    ) -> tuple[Float[np.ndarray, "M W G N"], Float[np.ndarray, "M W G N"]]:
        """Sums and counts of values in each scene."""
        used = is_valid & (self.cell >= 0)
        size = int(np.prod(self.shape))
        total = np.bincount(self.cell[used], values[used], size).astype(float)
        count = np.bincount(self.cell[used], minlength=size).astype(float)
        return self._united(total), self._united(count)

    def medians(
        self, values: Float[np.ndarray, "R"], is_valid: Bool[np.ndarray, "R"]
    ) -> Estimate:
        """Median of each cell, over all scenes; without intervals."""
        used = np.flatnonzero(is_valid & (self.cell >= 0))
        method, road = self.method[used], self.road[used]
        group, values = self.group[used], values[used]
        shape = (self.shape[0], len(self.roads), len(_HELD))
        found = np.full(shape, np.nan)
        for m, w, g in np.ndindex(shape):
            chosen = (method == m) & np.isin(road, self.roads[w])
            chosen &= np.isin(group, _HELD[g])
            if chosen.any():
                found[m, w, g] = np.median(values[chosen])
        unknown = np.full(shape, np.nan)
        return Estimate(value=found, low=unknown, high=unknown)

    def _united(self, flat: Float[np.ndarray, "K"]) -> Float[np.ndarray, "M W G N"]:
        table = flat.reshape(self.shape)
        table = np.stack([table[:, list(r)].sum(axis=1) for r in self.roads], axis=1)
        return np.stack([table[:, :, list(g)].sum(axis=2) for g in _HELD], axis=2)


@dataclass(frozen=True, kw_only=True, eq=False)
class _RowFile:
    """Rows of some splits, read column by column."""

    file: pq.ParquetFile
    is_kept: pa.Array | None

    def read(self, *names: str) -> pa.Table:
        table = self.file.read(columns=list(names))
        return table if self.is_kept is None else table.filter(self.is_kept)

    def metric(self, name: str) -> tuple[Float[np.ndarray, "R"], Bool[np.ndarray, "R"]]:
        """Values of a metric, and which of them are valid."""
        column = self.read(name).column(name)
        is_valid = column.is_valid().to_numpy()
        return column.fill_null(0.0).to_numpy().astype(float), is_valid


def _rows_of(path: Path, splits: Collection[str] | None) -> _RowFile:
    file = pq.ParquetFile(path, memory_map=True)
    if splits is None:
        return _RowFile(file=file, is_kept=None)
    wanted = tuple(splits)
    code = _codes(file.read(columns=["split"]), "split", wanted)
    return _RowFile(file=file, is_kept=pa.array(code >= 0))


def summarise(
    rows: Path,
    methods: Sequence[str],
    conditions: Sequence[RoadCondition],
    seed: int,
    splits: Collection[str] | None = None,
) -> Summary:
    """Summarise a file of rows, one metric at a time; ``splits`` None means all."""
    file = _rows_of(rows, splits)
    cells = _cells(file, methods, conditions)
    weights = scene_weights(cells.shape[3], seed)
    statistics = {
        name: _statistic(cells, *file.metric(name), weights) for name in METRIC_COLUMNS
    }
    final_m, is_valid = file.metric("lateral_deviation_final")
    far = (final_m > FAR_M).astype(float)
    statistics[FAR_FROM_LANE] = _statistic(cells, far, is_valid, weights)
    first = np.zeros(len(cells.cell), bool)
    whose = cells.agent * len(methods) + cells.method
    first[np.unique(whose, return_index=True)[1]] = True
    _, agents = cells.sums(np.zeros(len(first)), first)
    warped = (PERTURBED,) if len(cells.roads) > len(conditions) else ()
    return Summary(
        methods=tuple(methods),
        roads=(*(one.label for one in conditions), *warped),
        groups=SUMMARY_GROUPS,
        num_agents=agents.sum(axis=-1).astype(int),
        num_scenes=(agents > 0).sum(axis=-1),
        median_final=cells.medians(final_m, is_valid),
        statistics=statistics,
    )


def _cells(
    file: _RowFile, methods: Sequence[str], conditions: Sequence[RoadCondition]
) -> _Cells:
    keys = file.read(*_KEYS)
    roads = {(one.kind, one.power): row for row, one in enumerate(conditions)}
    number, _ = _numbered(keys, "warp", "power")
    _, first = np.unique(number, return_index=True)
    there = keys.select(["warp", "power"]).take(first).to_pylist()
    of_number = [roads.get((one["warp"], one["power"]), -1) for one in there]
    road = np.array(of_number, np.int64)[number] if len(number) else number
    scene, num_scenes = _numbered(keys, "split", "scenario_id")
    method = _codes(keys, "method", methods)
    name, num_names = _numbered(keys, "agent_id")
    whole = (scene * len(conditions) + road) * max(num_names, 1) + name
    agent = np.unique(whole, return_inverse=True)[1]
    is_logged = np.zeros(len(agent), bool)
    if GROUND_TRUTH in methods:
        is_logged = method == list(methods).index(GROUND_TRUTH)
    warped = tuple(row for row, one in enumerate(conditions) if not one.is_plain)
    together = (warped,) if warped else ()
    return _Cells(
        shape=(len(methods), len(conditions), len(_SEPARATE), max(num_scenes, 1)),
        method=method,
        road=road,
        group=_groups(keys),
        scene=scene,
        agent=agent,
        is_logged=is_logged,
        is_complete=keys.column("recorded").to_numpy() == 1.0,
        roads=(*((row,) for row in range(len(conditions))), *together),
    )


def _groups(keys: pa.Table) -> Int[np.ndarray, "R"]:
    """Index into ``_SEPARATE``; motor vehicles are divided by the log's columns."""
    group = _codes(keys, "group", _SEPARATE)
    is_motor_vehicle = _codes(keys, "group", ("movers",)) == 0
    drives = keys.column("under_way").to_numpy() & keys.column("on_lane").to_numpy()
    return np.where(is_motor_vehicle, np.where(drives, 0, 1), group)


def _statistic(
    cells: _Cells,
    values: Float[np.ndarray, "R"],
    is_valid: Bool[np.ndarray, "R"],
    weights: Float[np.ndarray, "S N"],
) -> Statistic:
    sums, counts = cells.sums(values, is_valid)
    logged = np.full(int(cells.agent.max(initial=-1)) + 1, np.nan)
    log = is_valid & cells.is_logged & cells.is_complete
    logged[cells.agent[log]] = values[log]
    difference = values - logged[cells.agent]
    is_paired = is_valid & np.isfinite(difference)
    apart, pairs = cells.sums(np.where(is_paired, difference, 0.0), is_paired)
    return Statistic(
        mean=mean_over_scenes(sums, counts, weights),
        difference=mean_over_scenes(apart, pairs, weights),
        num_scenes=(counts > 0).sum(axis=-1),
        num_pairs=pairs.sum(axis=-1).astype(int),
    )


def _codes(keys: pa.Table, name: str, known: Sequence[str]) -> Int[np.ndarray, "R"]:
    """Index of each text of a column among the known ones; -1 for others."""
    coded = keys.column(name).combine_chunks().dictionary_encode()
    place = {text: index for index, text in enumerate(known)}
    of_code = [place.get(text, -1) for text in coded.dictionary.to_pylist()]
    code = coded.indices.fill_null(len(of_code)).to_numpy()
    return np.array([*of_code, -1], np.int64)[code]


def _numbered(keys: pa.Table, *names: str) -> tuple[Int[np.ndarray, "R"], int]:
    """Index of each distinct combination of columns, and their number."""
    number = np.zeros(len(keys), np.int64)
    for name in names:
        coded = keys.column(name).combine_chunks().dictionary_encode()
        number = number * (len(coded.dictionary) + 1) + coded.indices.to_numpy()
    found, number = np.unique(number, return_inverse=True)
    return number, len(found)
