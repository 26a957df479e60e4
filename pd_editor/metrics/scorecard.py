"""Scorecard of a scene: its metrics beside what is usual in recordings."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Literal

import numpy as np

from pd_editor.metrics.collisions.safety import CRITICAL_S
from pd_editor.metrics.findings import Finding, judged_traffic
from pd_editor.metrics.metric_table import METRICS
from pd_editor.metrics.traffic_view import recorded_traffic
from pd_editor.scene.scenario import Scenario

Level = Literal["usual", "unusual", "extreme"]
TITLES: Final[Mapping[str, str]] = {
    "init_overlap": "Collisions at t = 0",
    "new_overlap": "Later collisions",
    "critical_time_to_collision": f"TTC under {CRITICAL_S:g} s",
    "off_drivable": "Off drivable area",
    "lateral_deviation_mean": "Distance to lanes",
    "wrong_way": "Wrong way",
    "uncomfortable": "Harsh motion",
    "impossible": "Impossible motion",
    "standing": "Standing at t = 0",
    "speed": "Speed at t = 0",
    "path_length": "Path length",
}
"""Metrics of the scorecard in the order of its rows."""


@dataclass(frozen=True, kw_only=True)
class UsualRange:
    """Quantiles of a metric's means in recorded scenes."""

    low: float
    """5 %."""
    quarter: float
    median: float
    three_quarters: float
    high: float
    """95 %."""
    num_scenes: int

    def level_of(self, name: str, value: float) -> Level:
        """How usual a scene's mean is.

        Beyond the 5 and 95 % quantiles it is unusual, and extreme where it is beyond
        them by more than the distance between the quartiles. Low values of metrics
        of which less is better are usual.
        """
        margin = max(self.three_quarters - self.quarter, self.high - self.median)
        beyond = value - self.high
        if METRICS[name].better != "lower":
            beyond = max(beyond, self.low - value)
        if beyond <= 0:
            return "usual"
        return "unusual" if beyond <= margin else "extreme"


@dataclass(frozen=True, kw_only=True)
class ScoreRow:
    """A row of the scorecard: the mean of one metric over the scene's motor vehicles."""

    name: str
    title: str
    value: float
    """NaN where no agent has a value."""
    unit: str
    usual: UsualRange
    level: Level
    findings: tuple[Finding, ...]
    """Agents that stand out, the worst first."""


def scorecard(scenario: Scenario) -> tuple[ScoreRow, ...]:
    """The scorecard of a scenario's own trajectories."""
    view = recorded_traffic(scenario)
    found = judged_traffic(view)
    is_mover = view.agents.is_in("movers")
    usual = usual_ranges()
    rows = []
    for name, title in TITLES.items():
        values = found[name].values
        counted = values.is_valid & is_mover
        mean = float(values.value[counted].mean()) if counted.any() else float("nan")
        rows.append(
            ScoreRow(
                name=name,
                title=title,
                value=mean,
                unit=values.unit,
                usual=usual[name],
                level="usual" if np.isnan(mean) else usual[name].level_of(name, mean),
                findings=found[name].findings(view, counted),
            )
        )
    return tuple(rows)


@cache
def usual_ranges() -> Mapping[str, UsualRange]:
    """What is usual in recorded scenes, by metric; from ``usual_values.csv``."""
    path = Path(__file__).with_name("usual_values.csv")
    with path.open(encoding="utf-8", newline="") as file:
        return {
            row["name"]: UsualRange(
                low=float(row["low"]),
                quarter=float(row["quarter"]),
                median=float(row["median"]),
                three_quarters=float(row["three_quarters"]),
                high=float(row["high"]),
                num_scenes=int(row["num_scenes"]),
            )
            for row in csv.DictReader(file)
        }
