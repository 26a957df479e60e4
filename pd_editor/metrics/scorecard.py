"""Scorecard of a scene: its metrics beside what is usual in recordings."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.metrics.collisions.box_collision import box_overlap
from pd_editor.metrics.collisions.safety import CRITICAL_S, safety_values
from pd_editor.metrics.metric_table import METRICS
from pd_editor.metrics.motion.kinematics import kinematics, motion_values
from pd_editor.metrics.road.lane_deviation import lane_deviation
from pd_editor.metrics.road.off_lane import off_lane
from pd_editor.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.metrics.values import MetricValues
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
class Occurrence:
    """Where a value is worst."""

    agent_id: str
    step: int
    """Step of the scenario."""


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
    worst: Occurrence | None
    """None where no agent stands out."""


def scorecard(scenario: Scenario) -> tuple[ScoreRow, ...]:
    """The scorecard of a scenario's own trajectories."""
    view = recorded_traffic(scenario)
    found = _measured(view)
    is_mover = view.agents.is_in("movers")
    usual = usual_ranges()
    rows = []
    for name, title in TITLES.items():
        values, excess = found[name]
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
                worst=_worst(view, counted, excess),
            )
        )
    return tuple(rows)


def scene_means(scenario: Scenario) -> dict[str, float]:
    """Means of the scorecard's metrics; NaN where no agent has a value."""
    return {row.name: row.value for row in scorecard(scenario)}


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


_Excess = Float[np.ndarray, "A H"] | None
"""How bad each agent is at each step, at most 0 where it is not; None: not told."""


def _measured(view: TrafficView) -> dict[str, tuple[MetricValues, _Excess]]:
    overlap, motion = box_overlap(view), kinematics(view)
    lanes, road = lane_deviation(view), off_lane(view)
    values = {
        **safety_values(view),
        **lanes.values(),
        **road.values(),
        **motion.values(),
        **motion_values(view),
    }
    at_state, newly = overlap.at_state(), overlap.newly()
    first = np.zeros(view.agents.is_valid.shape, bool)
    first[:, :1] = overlap.is_overlapping[:, :1]
    to_collision = values["time_to_collision"]
    critical = np.zeros(first.shape)
    critical[:, 0] = np.where(
        to_collision.is_valid, CRITICAL_S - to_collision.value, 0.0
    )
    force = np.hypot(motion.longitudinal_mps2, motion.lateral_mps2)
    return {
        "init_overlap": (at_state, first.astype(float)),
        "new_overlap": (newly, _first_steps(overlap.is_new)),
        "critical_time_to_collision": (values["critical_time_to_collision"], critical),
        "off_drivable": (values["off_drivable"], _first_steps(road.is_outside)),
        "lateral_deviation_mean": (
            values["lateral_deviation_mean"],
            np.where(lanes.is_valid, lanes.lateral_m, 0.0),
        ),
        "wrong_way": (values["wrong_way"], _first_steps(lanes.is_wrong_way)),
        "uncomfortable": (
            values["uncomfortable"],
            np.where(motion.is_uncomfortable() & motion.is_valid, force, 0.0),
        ),
        "impossible": (
            values["impossible"],
            np.where(motion.is_impossible() & motion.is_valid, force, 0.0),
        ),
        "standing": (values["standing"], None),
        "speed": (values["speed"], None),
        "path_length": (values["path_length"], None),
    }


def _first_steps(holds: Bool[np.ndarray, "A H"]) -> Float[np.ndarray, "A H"]:
    """More for agents where it holds longer, and at the first such step."""
    steps = np.arange(holds.shape[1], 0, -1)
    return holds * (holds.sum(axis=1, keepdims=True) + steps / (steps[0] + 1))


def _worst(
    view: TrafficView, counted: Bool[np.ndarray, "A"], excess: _Excess
) -> Occurrence | None:
    if excess is None or not counted.any():
        return None
    excess = np.where(counted[:, None], excess, 0.0)
    agent, step = np.unravel_index(int(excess.argmax()), excess.shape)
    if excess[agent, step] <= 0:
        return None
    return Occurrence(
        agent_id=view.agents.ids[agent],
        step=view.scenario.current_step + int(step),
    )
