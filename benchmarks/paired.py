"""Differences between methods of an evaluation, on the same agents of the same roads.

``python -m benchmarks.paired ROWS.parquet [MORE.parquet ...] --reference NAME``. Rows of
several evaluations with equal seeds are joined. Intervals hold 95 % of bootstrap resamples
of scenes; motor vehicles only. Power 0 is the plain road.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

METRICS: Mapping[str, float] = {
    "new_overlap": 100, "ade": 1, "min_ade": 1, "off_drivable": 100,
    "lateral_deviation_final": 1, "path_length": 1, "impossible": 100,
}  # fmt: skip
"""Columns of the rows, with the factor by which they are printed."""
RESAMPLES = 2000

Values = dict[tuple[str, ...], np.ndarray]
"""Metrics of each method, road, scene and agent, as means over samples."""


def read(paths: list[Path]) -> Values:
    """Means over the samples of each agent."""
    keys = ("method", "warp", "scenario_id", "agent_id")
    rows: dict[tuple[str, ...], list[list[float]]] = {}
    seen: dict[tuple[str, ...], int] = {}
    for number, path in enumerate(paths):
        table = pq.read_table(path, columns=[*keys, "group", *METRICS])
        for row in table.to_pylist():
            key = tuple(row[name] for name in keys)
            # Reference methods are in each of the files.
            if row["group"] == "movers" and seen.setdefault(key, number) == number:
                values = [row[name] for name in METRICS]
                rows.setdefault(key, []).append(
                    [np.nan if one is None else one for one in values]
                )
    with np.errstate(all="ignore"):
        return {key: mean_of(np.array(found, float)) for key, found in rows.items()}


def mean_of(values: np.ndarray) -> np.ndarray:
    """Means over the known values of each column; NaN where there is none."""
    known = np.isfinite(values)
    return np.where(known, values, 0.0).sum(axis=0) / known.sum(axis=0)


def table_of(values: Values, method: str, roads: set[str]) -> dict:
    """Of each agent on some roads."""
    return {
        key[1:]: one
        for key, one in values.items()
        if key[0] == method and key[1] in roads
    }


def line(name: str, found: dict) -> str:
    """Means over agents with intervals over scenes."""
    scenes = sorted({key[1] for key in found})
    place = {scene: row for row, scene in enumerate(scenes)}
    sums = np.zeros((len(scenes), len(METRICS)))
    counts = np.zeros_like(sums)
    for key, one in found.items():
        sums[place[key[1]]] += np.nan_to_num(one)
        counts[place[key[1]]] += np.isfinite(one)
    drawn = np.random.default_rng(0).integers(
        len(scenes), size=(RESAMPLES, len(scenes))
    )
    with np.errstate(all="ignore"):
        resampled = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
        mean = sums.sum(axis=0) / counts.sum(axis=0)
    low, high = np.nanquantile(resampled, [0.025, 0.975], axis=0)
    cells = [
        f"{factor * value:8.2f} [{factor * least:6.2f}, {factor * most:6.2f}]"
        for factor, value, least, most in zip(
            METRICS.values(), mean, low, high, strict=True
        )
    ]
    return f"{name:44.44}" + "".join(cells)


def main() -> None:
    """Print each method, and its difference from the reference."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--reference", required=True)
    options = parser.parse_args()
    values = read(options.rows)
    methods = list(dict.fromkeys(key[0] for key in values))
    warps = {key[1] for key in values}
    for name, roads in (("plain", warps & {"none"}), ("warped", warps - {"none"})):
        if not roads:
            continue
        print(f"{name:44}" + "".join(f"{metric:>25}" for metric in METRICS))
        reference = table_of(values, options.reference, roads)
        for method in methods:
            found = table_of(values, method, roads)
            print(line(method, found))
            if method not in (options.reference, "ground-truth"):
                apart = {
                    key: one - reference[key]
                    for key, one in found.items()
                    if key in reference
                }
                print(line("    minus the reference", apart))


if __name__ == "__main__":
    main()
