"""Scorecard of a scene: totals of its findings, and metrics, beside what is usual."""

import csv
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Literal

import numpy as np

from pd_editor.analysis.findings.check import scene_findings
from pd_editor.analysis.findings.collisions import NEAR_PASS_M
from pd_editor.analysis.findings.finding import Finding, FindingKind, finding_of_agent
from pd_editor.analysis.findings.motion import LEAST_AGAINST_S
from pd_editor.analysis.metrics.lanes import lane_deviation
from pd_editor.analysis.metrics.motion import motion_values
from pd_editor.analysis.metrics.safety import CRITICAL_S
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import METRICS, MetricValues
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

Level = Literal["usual", "unusual", "extreme"]
MAX_FINDINGS: Final = 200
"""Limit of the findings of one row, the worst first."""


@dataclass(frozen=True, kw_only=True)
class Total:
    """A row that counts the agents of findings."""

    title: str
    kinds: frozenset[FindingKind]
    meaning: str


TOTALS: Final[Mapping[str, Total]] = {
    "init_overlap": Total(
        title="Collisions at t = 0",
        kinds=frozenset({"collision"}),
        meaning="that overlap another agent at t = 0.",
    ),
    "new_overlap": Total(
        title="Later collisions",
        kinds=frozenset({"later-collision"}),
        meaning="that come to overlap another agent later.",
    ),
    "near_pass": Total(
        title=f"Passes under {NEAR_PASS_M:g} m",
        kinds=frozenset({"near-pass"}),
        meaning="that are as near to another road user, one of both moving.",
    ),
    "critical_time_to_collision": Total(
        title=f"Under {CRITICAL_S:g} s to a collision",
        kinds=frozenset({"short-time"}),
        meaning="that would hit another agent within this time, and do not collide with it.",
    ),
    "off_drivable": Total(
        title="Off the road",
        kinds=frozenset({"off-road", "later-off-road"}),
        meaning="off the drivable area at any time, beyond the mapped road excepted.",
    ),
    "wrong_way": Total(
        title="Against traffic",
        kinds=frozenset({"against-traffic"}),
        meaning=f"that move against all lanes there for {LEAST_AGAINST_S:g} s or longer.",
    ),
    "uncomfortable": Total(
        title="Harsh motion",
        kinds=frozenset({"harsh-motion"}),
        meaning="beyond a limit of comfort at any time.",
    ),
    "impossible": Total(
        title="Impossible motion",
        kinds=frozenset({"impossible-motion", "friction"}),
        meaning="that accelerate or turn as no vehicle can, or too fast for the grip.",
    ),
}
"""Rows that are totals of the list of findings."""
MEANS: Final[Mapping[str, tuple[str, FindingKind]]] = {
    "lateral_deviation_mean": ("Distance to lanes", "far-from-lane"),
    "standing": ("Standing at t = 0", "standing"),
    "speed": ("Speed at t = 0", "fastest"),
    "path_length": ("Path length", "longest"),
}
"""Rows that are means of metrics, with the kind of finding that they tell."""
ROWS: Final = (*TOTALS, *MEANS)
"""Names of all rows, in their order."""


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
        if name in MEANS and METRICS[name].better != "lower":
            beyond = max(beyond, self.low - value)
        if beyond <= 0:
            return "usual"
        return "unusual" if beyond <= margin else "extreme"


@dataclass(frozen=True, kw_only=True)
class ScoreRow:
    """A row of the scorecard: the mean of one metric over the scene's motor vehicles."""

    name: str
    title: str
    meaning: str
    value: float
    """NaN where no agent has a value."""
    unit: str
    usual: UsualRange
    level: Level
    findings: tuple[Finding, ...]
    """What it counts, the worst first."""


def scorecard(
    scenario: Scenario, findings: Collection[Finding] | None = None
) -> tuple[ScoreRow, ...]:
    """The scorecard of a scenario's own trajectories.

    ``findings`` are those of the scenario; they are looked for if not given.
    """
    if findings is None:
        findings = scene_findings(scenario)
    view = recorded_traffic(scenario)
    movers = {
        view.agents.ids[row] for row in np.flatnonzero(view.agents.is_in("movers"))
    }
    rows = []
    for name, total in TOTALS.items():
        found = [
            one
            for one in findings
            if one.kind in total.kinds and not movers.isdisjoint(one.agent_ids)
        ]
        named = movers.intersection(agent for one in found for agent in one.agent_ids)
        share = len(named) / len(movers) if movers else float("nan")
        meaning = f"Share of motor vehicles {total.meaning}"
        rows.append(_row(name, total.title, meaning, share, "share", found))
    for name, values, mean, found in _means(view):
        of_all = "Share" if values.unit == "share" else "Mean"
        meaning = f"{of_all} of motor vehicles. {METRICS[name].definition}"
        rows.append(_row(name, MEANS[name][0], meaning, mean, values.unit, found))
    return tuple(rows)


def _row(
    name: str,
    title: str,
    meaning: str,
    value: float,
    unit: str,
    findings: Iterable[Finding],
) -> ScoreRow:
    usual = usual_ranges()[name]
    return ScoreRow(
        name=name,
        title=title,
        meaning=meaning,
        value=value,
        unit=unit,
        usual=usual,
        level="usual" if np.isnan(value) else usual.level_of(name, value),
        findings=tuple(sorted(findings, key=lambda one: -one.ratio)[:MAX_FINDINGS]),
    )


def _means(
    view: TrafficView,
) -> Iterator[tuple[str, MetricValues, float, list[Finding]]]:
    """Metrics by name, their means over motor vehicles, and the agents to tell of."""
    is_mover, motion = view.agents.is_in("movers"), motion_values(view)
    lanes = lane_deviation(view)
    metrics = {**motion, **lanes.values()}
    lateral = np.where(lanes.is_valid, lanes.lateral_m, 0.0)
    scenario, ids = view.scenario, view.agents.ids
    for name, (_, kind) in MEANS.items():
        values = metrics[name]
        counted = values.is_valid & is_mover
        some = values.value[counted]
        if kind == "far-from-lane":
            worst, value = lateral.argmax(axis=1), lateral.max(axis=1, initial=0.0)
            # Agents further than this from all reachable lanes are told.
            told = counted & (value > 2.0)
        else:
            worst, value = np.zeros(len(view), int), values.value
            most = max(some.max(initial=0.0), MOVING_MPS)
            told = counted & (value > 0 if kind == "standing" else value >= most)
        rows = np.flatnonzero(told)
        rows = rows[np.argsort(-value[rows], kind="stable")[:MAX_FINDINGS]]
        found = [
            finding_of_agent(
                scenario,
                kind,
                scenario.agents.row_of[ids[row]],
                np.array([scenario.current_step + worst[row]]),
                value=float(value[row]),
                words=(
                    _WORDS[kind].format(value[row]),
                    f"is told beside {MEANS[name][0].lower()}.",
                ),
            )
            for row in rows.tolist()
        ]
        yield name, values, float(some.mean()) if len(some) else float("nan"), found


_WORDS: Final[Mapping[str, str]] = {
    "far-from-lane": " {:.1f} m from its lane",
    "standing": " stands",
    "fastest": ", the fastest, {:.1f} m/s",
    "longest": ", the longest, {:.0f} m",
}


@cache
def usual_ranges() -> Mapping[str, UsualRange]:
    """What is usual in recorded scenes, by metric; from ``usual_values.csv``."""
    path = Path(__file__).with_name("usual_values.csv")
    with path.open(encoding="utf-8", newline="") as file:
        return {
            row.pop("name"): UsualRange(
                num_scenes=int(row.pop("num_scenes")),
                **{name: float(value) for name, value in row.items()},
            )
            for row in csv.DictReader(file)
        }
