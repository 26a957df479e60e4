"""Table of all metrics: unit, source, preferred direction, definition."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

Source = Literal["paper", "ours", "WOSAC", "Scenario Dreamer"]
Better = Literal["lower", "higher", "as recorded"]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """Name, unit and meaning of a metric."""

    name: str
    unit: str
    """"share" is a number in 0..1; for a single agent it is true or false."""
    source: Source
    """"paper": as Path Diffuser's code computes it, faults included; "WOSAC": after Waymo's
    sim agents challenge."""
    better: Better
    definition: str


def _metrics() -> dict[str, Metric]:
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        rows: list[dict[str, Any]] = list(csv.DictReader(file))
    return {row["name"]: Metric(**row) for row in rows}


METRICS: Final[Mapping[str, Metric]] = _metrics()
"""All metrics of agents by name, read from ``metric_table.csv``; distances of
distributions are computed from them."""
