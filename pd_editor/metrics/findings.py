"""Agents and times that the metrics of a scorecard are about."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.metrics.collisions.box_collision import BoxOverlap, box_overlap
from pd_editor.metrics.collisions.safety import CRITICAL_S, safety_values
from pd_editor.metrics.motion.kinematics import (
    COMFORT_ACCELERATION_MPS2,
    COMFORT_BRAKING_MPS2,
    COMFORT_JERK_MPS3,
    COMFORT_LATERAL_MPS2,
    COMFORT_YAW_RATE_RADPS,
    MAX_ACCELERATION_MPS2,
    MAX_CURVATURE_PER_M,
    TURNING_MPS,
    Kinematics,
    kinematics,
    motion_values,
)
from pd_editor.metrics.road.lane_deviation import LaneDeviation, lane_deviation
from pd_editor.metrics.road.off_lane import OffLane, off_lane
from pd_editor.metrics.step_spans import Spans, holds_at, spans_of
from pd_editor.metrics.traffic_view import TrafficView
from pd_editor.metrics.values import MetricValues
from pd_editor.scene.thresholds import MOVING_MPS

MAX_FINDINGS: Final = 200
"""Limit of the findings of one metric, the worst first."""
FAR_FROM_LANE_M: Final = 2.0
"""Agents further than this from all reachable lanes are findings."""

HARD_FAULTS: Final = frozenset(
    {"init_overlap", "new_overlap", "off_drivable", "impossible"}
)
"""Metrics whose findings do not occur in sound traffic."""
MILD_FAULTS: Final = frozenset(
    {"critical_time_to_collision", "wrong_way", "uncomfortable"}
)
"""Metrics whose findings are rare in sound traffic."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An agent that a metric is about, and the steps at which it is."""

    metric: str
    agent_id: str
    spans: Spans
    """Steps of the scenario."""
    worst_step: int
    text: str
    """What there is, without the agent: "brakes with 5.2 m/s²"."""

    @property
    def is_fault(self) -> bool:
        """Whether it is a fault, not only a property of the scene."""
        return self.metric in HARD_FAULTS or self.metric in MILD_FAULTS

    def holds_at(self, step: float) -> bool:
        """Whether it holds at a step."""
        return holds_at(self.spans, step)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """Values of one metric, and how bad each agent is at each step."""

    values: MetricValues
    """[A]."""
    excess: Float[np.ndarray, "A H"]
    """At most 0 where the agent is no finding."""
    tell: Callable[[int, int], str]
    """Describes the finding of an agent and a step."""

    def findings(
        self, view: TrafficView, counted: Bool[np.ndarray, "A"]
    ) -> tuple[Finding, ...]:
        """Findings of some agents, the worst first."""
        excess = np.where(counted[:, None], self.excess, 0.0)
        most = excess.max(axis=1, initial=0.0)
        order = np.argsort(-most, kind="stable")[:MAX_FINDINGS]
        now = view.scenario.current_step
        found = []
        for row in order[most[order] > 0].tolist():
            worst = int(excess[row].argmax())
            found.append(
                Finding(
                    metric=self.values.name,
                    agent_id=view.agents.ids[row],
                    spans=spans_of(np.flatnonzero(excess[row] > 0) + now),
                    worst_step=now + worst,
                    text=self.tell(row, worst),
                )
            )
        return tuple(found)


def judged_traffic(view: TrafficView) -> Mapping[str, Judged]:
    """The metrics of a scorecard by name."""
    values = {**safety_values(view), **motion_values(view)}
    return {
        one.values.name: one
        for one in (
            *_collisions(box_overlap(view), view.step_s),
            _critical(values),
            *_road(off_lane(view), lane_deviation(view), view.step_s),
            *_motion(kinematics(view)),
            *_states(view, values),
        )
    }


def _collisions(overlap: BoxOverlap, step_s: float) -> tuple[Judged, Judged]:
    first = np.zeros(overlap.is_valid.shape)
    first[:, :1] = overlap.is_overlapping[:, :1]
    is_new = overlap.is_new
    return (
        Judged(
            values=overlap.at_state(),
            excess=first,
            tell=lambda _row, _step: "collides at t = 0",
        ),
        Judged(
            values=overlap.newly(),
            excess=_first_steps(is_new),
            tell=lambda row, _step: f"collides for {_seconds(is_new[row], step_s)}",
        ),
    )


def _critical(values: Mapping[str, MetricValues]) -> Judged:
    to_collision = values["time_to_collision"]
    least = to_collision.value
    critical = values["critical_time_to_collision"]
    excess = np.zeros((len(least), 1))
    excess[:, 0] = np.where(to_collision.is_valid, CRITICAL_S - least, 0.0)
    return Judged(
        values=critical,
        excess=excess,
        tell=lambda row, _step: f"time to collision {least[row]:.1f} s",
    )


def _road(road: OffLane, lanes: LaneDeviation, step_s: float) -> tuple[Judged, ...]:
    off, wrong = road.is_outside, lanes.is_wrong_way
    lateral = np.where(lanes.is_valid, lanes.lateral_m, 0.0)
    return (
        Judged(
            values=road.values()["off_drivable"],
            excess=_first_steps(off),
            tell=lambda row, _step: f"off the road for {_seconds(off[row], step_s)}",
        ),
        Judged(
            values=lanes.values()["lateral_deviation_mean"],
            excess=np.maximum(lateral - FAR_FROM_LANE_M, 0.0),
            tell=lambda row, step: f"{lateral[row, step]:.1f} m from its lane",
        ),
        Judged(
            values=lanes.values()["wrong_way"],
            excess=_first_steps(wrong),
            tell=lambda row, _step: (
                f"against its lane for {_seconds(wrong[row], step_s)}"
            ),
        ),
    )


def _motion(motion: Kinematics) -> tuple[Judged, Judged]:
    forward, lateral = motion.longitudinal_mps2, motion.lateral_mps2
    yaw, total = np.abs(motion.yaw_rate_radps), np.hypot(forward, lateral)
    turns = motion.speed_mps > TURNING_MPS
    bend = np.where(turns, yaw / np.where(turns, motion.speed_mps, 1.0), 0.0)
    comfort = (
        forward / COMFORT_BRAKING_MPS2,
        forward / COMFORT_ACCELERATION_MPS2,
        np.abs(lateral) / COMFORT_LATERAL_MPS2,
        motion.jerk_mps3 / COMFORT_JERK_MPS3,
        yaw / COMFORT_YAW_RATE_RADPS,
    )
    physics = (total / MAX_ACCELERATION_MPS2, bend / MAX_CURVATURE_PER_M)

    def harsh(row: int, step: int) -> str:
        at = row, step
        return (
            f"brakes with {-forward[at]:.1f} m/s\u00b2",
            f"accelerates with {forward[at]:.1f} m/s\u00b2",
            f"{abs(lateral[at]):.1f} m/s\u00b2 sideways",
            f"jerk of {motion.jerk_mps3[at]:.0f} m/s\u00b3",
            f"turns with {np.degrees(yaw[at]):.0f} \u00b0/s",
        )[int(np.argmax([ratio[at] for ratio in comfort]))]

    def impossible(row: int, step: int) -> str:
        at = row, step
        if physics[0][at] >= physics[1][at]:
            return f"{total[at]:.0f} m/s\u00b2 in all"
        return f"radius of {1 / bend[at]:.1f} m"

    return (
        _beyond_one(motion.values()["uncomfortable"], comfort, motion.is_valid, harsh),
        _beyond_one(
            motion.values()["impossible"], physics, motion.is_valid, impossible
        ),
    )


def _states(
    view: TrafficView, values: Mapping[str, MetricValues]
) -> tuple[Judged, ...]:
    """Agents that stand, the fastest one, and the one with the longest path."""
    speed, length, stands = (
        values[name] for name in ("speed", "path_length", "standing")
    )
    movers = view.agents.is_in("movers")

    def most(of: MetricValues) -> Float[np.ndarray, "A 1"]:
        counted = of.is_valid & movers
        highest = of.value.max(where=counted, initial=0.0)
        return (counted & (of.value == highest) & (highest >= MOVING_MPS))[
            :, None
        ].astype(float)

    return (
        Judged(
            values=stands,
            excess=stands.value[:, None].astype(float),
            tell=lambda _row, _step: "stands",
        ),
        Judged(
            values=speed,
            excess=most(speed),
            tell=lambda row, _step: f"the fastest, {speed.value[row]:.1f} m/s",
        ),
        Judged(
            values=length,
            excess=most(length),
            tell=lambda row, _step: f"the longest, {length.value[row]:.0f} m",
        ),
    )


def _beyond_one(
    values: MetricValues,
    ratios: tuple[Float[np.ndarray, "A H"], ...],
    is_valid: Bool[np.ndarray, "A H"],
    tell: Callable[[int, int], str],
) -> Judged:
    """Where one of several ratios to limits is above 1."""
    highest = np.max(np.stack(ratios), axis=0)
    excess = np.where(is_valid, np.maximum(highest - 1.0, 0.0), 0.0)
    return Judged(values=values, excess=excess, tell=tell)


def _first_steps(holds: Bool[np.ndarray, "A H"]) -> Float[np.ndarray, "A H"]:
    """More for agents where it holds longer, and at the first such step."""
    steps = np.arange(holds.shape[1], 0, -1)
    return holds * (holds.sum(axis=1, keepdims=True) + steps / (steps[0] + 1))


def _seconds(holds: Bool[np.ndarray, "H"], step_s: float) -> str:
    return f"{holds.sum() * step_s:.1f} s"
