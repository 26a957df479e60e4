"""Rows per agent summed up: per method, road and group, and against the log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from pd_editor.evaluation.bootstrap import Estimate, mean_over_scenes, scene_weights
from pd_editor.evaluation.reference_methods import GROUND_TRUTH
from pd_editor.evaluation.road_condition import RoadCondition
from pd_editor.evaluation.scene_rows import METRIC_COLUMNS
from pd_editor.metrics.traffic_view import GROUP_KINDS

PERTURBED: Final = "perturbed"
"""All bent roads together."""
FAR_M: Final = 2.0
FAR_FROM_LANE: Final = "lateral_deviation_final_over_2m"
"""Share of agents that end more than 2 m from their lanes."""
_KEYS: Final = ("scenario_id", "split", "method", "warp", "power", "agent_id", "group")


@dataclass(frozen=True, kw_only=True, eq=False)
class Statistic:
    """Means of one metric for M methods, W roads and G groups."""

    mean: Estimate
    """[M W G]."""
    difference: Estimate
    """Minus the log's, on the same agents [M W G]."""
    num_values: Int[np.ndarray, "M W G"]
    """Agents times samples."""
    num_scenes: Int[np.ndarray, "M W G"]
    num_pairs: Int[np.ndarray, "M W G"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """All statistics by metric."""

    methods: tuple[str, ...]
    roads: tuple[str, ...]
    """Labels of the roads; ``perturbed`` last where there is any bent one."""
    groups: tuple[str, ...]
    num_agents: Int[np.ndarray, "M W G"]
    """Different agents."""
    num_scenes: Int[np.ndarray, "M W G"]
    median_final_m: Float[np.ndarray, "M W G"]
    """Median final lateral deviation."""
    statistics: Mapping[str, Statistic]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """Which cell each row falls into."""

    shape: tuple[int, int, int, int]
    """Methods, roads as judged, groups, scenes."""
    cell: Int[np.ndarray, "R"]
    """-1 for rows of no group."""
    agent: Int[np.ndarray, "R"]
    """Number of the agent on its road, the same for all methods."""
    is_logged: Bool[np.ndarray, "R"]
    bent: Int[np.ndarray, "B"]
    """Rows of the roads that are bent."""

    def sums(
        self, values: Float[np.ndarray, "R"], is_valid: Bool[np.ndarray, "R"]
    ) -> tuple[Float[np.ndarray, "M W G N"], Float[np.ndarray, "M W G N"]]:
        """Sums and counts in each scene, all bent roads together last."""
        used = is_valid & (self.cell >= 0)
        size = int(np.prod(self.shape))
        total = np.bincount(self.cell[used], values[used], size).reshape(self.shape)
        count = np.bincount(self.cell[used], minlength=size).reshape(self.shape)
        return self.with_bent(total), self.with_bent(count.astype(float))

    def with_bent(self, table: np.ndarray) -> np.ndarray:
        """A table with a further road: all bent ones, summed."""
        if not len(self.bent):
            return table
        return np.concatenate(
            [table, table[:, self.bent].sum(axis=1, keepdims=True)], axis=1
        )


def summarise(
    rows: Path,
    methods: Sequence[str],
    conditions: Sequence[RoadCondition],
    seed: int,
) -> Summary:
    """Sum up a file of rows, one metric at a time."""
    file = pq.ParquetFile(rows, memory_map=True)
    keys = file.read(columns=list(_KEYS))
    cells = _cells(keys, methods, conditions)
    weights = scene_weights(cells.shape[3], seed)
    statistics, median = {}, np.zeros(0)
    for name in METRIC_COLUMNS:
        column = file.read(columns=[name]).column(name)
        is_valid = column.is_valid().to_numpy()
        values = column.fill_null(0.0).to_numpy().astype(float)
        statistics[name] = _statistic(cells, values, is_valid, weights)
        if name == "lateral_deviation_final":
            far = (values > FAR_M).astype(float)
            statistics[FAR_FROM_LANE] = _statistic(cells, far, is_valid, weights)
            median = _medians(cells, values, is_valid)
    first = np.zeros(len(cells.cell), bool)
    whose = cells.agent * len(methods) + _codes(keys, "method", methods)
    first[np.unique(whose, return_index=True)[1]] = True
    _, agents = cells.sums(np.zeros(len(first)), first)
    bent = (PERTURBED,) if len(cells.bent) else ()
    return Summary(
        methods=tuple(methods),
        roads=(*(one.label for one in conditions), *bent),
        groups=tuple(GROUP_KINDS),
        num_agents=agents.sum(axis=-1).astype(int),
        num_scenes=(agents > 0).sum(axis=-1),
        median_final_m=median,
        statistics=statistics,
    )


def _cells(
    keys: pa.Table, methods: Sequence[str], conditions: Sequence[RoadCondition]
) -> _Cells:
    roads = {(one.kind, one.power): row for row, one in enumerate(conditions)}
    number, _ = _numbered(keys, "warp", "power")
    _, first = np.unique(number, return_index=True)
    there = keys.select(["warp", "power"]).take(first).to_pylist()
    of_number = [roads.get((one["warp"], one["power"]), -1) for one in there]
    road = np.array(of_number, np.int64)[number] if len(number) else number
    scene, num_scenes = _numbered(keys, "split", "scenario_id")
    method = _codes(keys, "method", methods)
    group = _codes(keys, "group", tuple(GROUP_KINDS))
    name, num_names = _numbered(keys, "agent_id")
    shape = (len(methods), len(conditions), len(GROUP_KINDS), max(num_scenes, 1))
    cell = ((method * shape[1] + road) * shape[2] + group) * shape[3] + scene
    whole = (scene * shape[1] + road) * max(num_names, 1) + name
    agent = np.unique(whole, return_inverse=True)[1]
    is_logged = np.zeros(len(cell), bool)
    if GROUND_TRUTH in methods:
        is_logged = method == list(methods).index(GROUND_TRUTH)
    return _Cells(
        shape=shape,
        cell=np.where((group >= 0) & (method >= 0) & (road >= 0), cell, -1),
        agent=agent,
        is_logged=is_logged,
        bent=np.flatnonzero([not one.is_plain for one in conditions]),
    )


def _statistic(
    cells: _Cells,
    values: Float[np.ndarray, "R"],
    is_valid: Bool[np.ndarray, "R"],
    weights: Float[np.ndarray, "S N"],
) -> Statistic:
    sums, counts = cells.sums(values, is_valid)
    logged = np.full(int(cells.agent.max(initial=-1)) + 1, np.nan)
    log = is_valid & cells.is_logged
    logged[cells.agent[log]] = values[log]
    difference = values - logged[cells.agent]
    is_paired = is_valid & np.isfinite(difference)
    apart, pairs = cells.sums(np.where(is_paired, difference, 0.0), is_paired)
    return Statistic(
        mean=mean_over_scenes(sums, counts, weights),
        difference=mean_over_scenes(apart, pairs, weights),
        num_values=counts.sum(axis=-1).astype(int),
        num_scenes=(counts > 0).sum(axis=-1),
        num_pairs=pairs.sum(axis=-1).astype(int),
    )


def _medians(
    cells: _Cells, values: Float[np.ndarray, "R"], is_valid: Bool[np.ndarray, "R"]
) -> Float[np.ndarray, "M W G"]:
    """Median of each cell, all bent roads together last."""
    num_methods, num_roads, num_groups, num_scenes = cells.shape
    used = np.flatnonzero(is_valid & (cells.cell >= 0))
    cell = cells.cell[used] // num_scenes
    found = np.full((num_methods, num_roads, num_groups), np.nan)
    for index in np.unique(cell).tolist():
        found.flat[index] = np.median(values[used[cell == index]])
    if not len(cells.bent):
        return found
    together = np.full((num_methods, 1, num_groups), np.nan)
    road = cell // num_groups % num_roads
    is_bent = np.isin(road, cells.bent)
    whole = cell // (num_groups * num_roads) * num_groups + cell % num_groups
    for index in np.unique(whole[is_bent]).tolist():
        chosen = used[is_bent & (whole == index)]
        together.flat[index] = np.median(values[chosen])
    return np.concatenate([found, together], axis=1)


def _codes(keys: pa.Table, name: str, known: Sequence[str]) -> Int[np.ndarray, "R"]:
    """Place of each text of a column among the known ones, -1 for others."""
    coded = keys.column(name).combine_chunks().dictionary_encode()
    place = {text: index for index, text in enumerate(known)}
    of_code = [place.get(text, -1) for text in coded.dictionary.to_pylist()]
    code = coded.indices.fill_null(len(of_code)).to_numpy()
    return np.array([*of_code, -1], np.int64)[code]


def _numbered(keys: pa.Table, *names: str) -> tuple[Int[np.ndarray, "R"], int]:
    """A number for each different combination of columns, and how many there are."""
    number = np.zeros(len(keys), np.int64)
    for name in names:
        coded = keys.column(name).combine_chunks().dictionary_encode()
        number = number * (len(coded.dictionary) + 1) + coded.indices.to_numpy()
    found, number = np.unique(number, return_inverse=True)
    return number, len(found)
