"""Outcomes of guidance terms: what was asked, what a sample achieved."""

from collections.abc import Callable, Collection, Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.feasibility import absences
from pd_editor.analysis.guidance.limits import (
    LIMIT_BRAKING_MPS2,
    MAX_BRAKING_MPS2,
    OBEYED_ACCELERATION_MPS2,
    OBEYED_GOAL_M,
    OBEYED_OUTSIDE_M,
    OBEYED_OVERRUN_M,
    OBEYED_PATH_M,
    OBEYED_SPEED_MPS,
)
from pd_editor.analysis.guidance.measured import Driven, Measured, of_several
from pd_editor.analysis.guidance.pair_outcomes import (
    collision_outcome,
    gap_outcome,
    threat_measured,
    yield_outcome,
)
from pd_editor.analysis.guidance.road_distance import way_back_m
from pd_editor.analysis.guidance.stop_line import overrun_m
from pd_editor.analysis.metrics.motion.kinematics import kinematics
from pd_editor.analysis.metrics.traffic_view import generated_traffic
from pd_editor.scene.agent_kind import (
    LANE_FOLLOWER_KINDS,
    MOTOR_VEHICLE_KINDS,
    ROAD_USER_KINDS,
)
from pd_editor.scene.geometry.frenet import FrenetFrames
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.guidance_outcome import TermOutcome
from pd_editor.scene.guidance_terms import (
    AvoidCollisions,
    ComfortLimits,
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    KeepGap,
    SpeedLimit,
    StayOnRoad,
    StopAtLine,
    TargetSpeed,
    Threaten,
    YieldTo,
)
from pd_editor.scene.paths.drawn_path import lane_line, path_to_follow
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.scene.traffic_sample import TrafficSample

_LAST_S: Final = 1.0
"""Time at the end over which a target speed is measured."""
_MERGED_S: Final = 2.0
"""Time after which an agent should be on the path that it follows."""
_ROAD_STRIDE: Final = 3
SLOWED: Final = ", slowed to avoid a collision"
"""Ends what agents achieved that yielded afterwards."""


def term_outcomes(
    scenario: Scenario,
    sample: TrafficSample,
    terms: Sequence[GuidanceTerm],
    infeasible: Collection[GuidanceTerm] = (),
    slowed_ids: Collection[str] = (),
) -> tuple[TermOutcome, ...]:
    """Outcome of each term in a sample, also of those that had no effect in it.

    ``infeasible`` terms were known to be so before the run. Agents with ``slowed_ids``
    were slowed afterwards to avoid a collision.
    """
    driven = Driven(scenario=scenario, sample=sample)
    found: list[TermOutcome] = []
    for term in terms:
        measure = MEASURES.get(type(term))
        measured = None if measure is None else measure(term, driven)
        is_run = measured is not None
        if measured is None:
            measured = _without_effect(term, driven)
        ids = term.guided_ids or (measured.worst_id,)
        is_slowed = not set(slowed_ids).isdisjoint(ids)
        is_feasible = measured.is_feasible and term not in infeasible
        found.append(
            TermOutcome(
                term=term,
                is_run=is_run,
                is_feasible=is_feasible,
                asked=measured.asked,
                achieved=measured.achieved + SLOWED * is_slowed,
                error=measured.error,
                unit=measured.unit,
                is_obeyed=measured.is_obeyed
                and (is_feasible or not measured.has_no_case),
            )
        )
    return tuple(found)


def _without_effect(term: GuidanceTerm, driven: Driven) -> Measured:
    """Why a term had no effect: what is said before a run of agents that are missing."""
    found = absences(driven.scenario, term, driven.sample.ids)
    _, why = next(
        found, ("", "No regenerated agent is of its kinds, or can follow it.")
    )
    return Measured(
        asked=term.name,
        achieved=f"nothing: {why[0].lower()}{why[1:-1]}",
        error=float("nan"),
        unit="",
        is_obeyed=False,
    )


def _goal(term: GoalPoint, driven: Driven) -> Measured | None:
    row = driven.row(term.agent_id)
    if row is None:
        return None
    step = driven.num_steps - 1
    if term.at_s is not None:
        step = min(max(round(term.at_s / driven.step_s), 0), step)
    gap = driven.sample.position_m[row, step] - np.array(term.point_m)
    error = float(np.hypot(*gap))
    x, y = term.point_m
    return Measured(
        asked=f"at ({x:.1f}, {y:.1f}) m after {step * driven.step_s:.1f} s",
        achieved=f"{error:.1f} m away",
        error=error,
        unit="m",
        is_obeyed=error <= OBEYED_GOAL_M,
    )


def _path(term: FollowPath, driven: Driven) -> Measured | None:
    return _line(term.agent_id, np.array(term.points_m), "the path", driven)


def _lane(term: FollowLane, driven: Driven) -> Measured | None:
    line = lane_line(driven.scenario.road_map, term.lane_ids)
    if line is None or len(line) < 2:
        return None
    lanes = "lane" if len(term.lane_ids) == 1 else "lanes"
    words = f"{lanes} {', '.join(map(str, term.lane_ids[:3]))}"
    return _line(term.agent_id, line, words, driven)


def _line(
    agent_id: str, line_m: Float[np.ndarray, "N 2"], words: str, driven: Driven
) -> Measured | None:
    """Mean distance to the side of the path that joins a line, after the first seconds."""
    row = driven.row(agent_id)
    if row is None:
        return None
    sample = driven.sample
    followed = path_to_follow(
        line_m,
        sample.position_m[row, 0],
        float(sample.heading_rad[row, 0]),
        float(driven.speed_mps()[row, 0]),
    )
    path, length = followed.path, followed.length_m
    points = np.stack([path.x_m, path.y_m], axis=-1)
    along, beside = FrenetFrames(points_m=points).to_frenet(
        sample.position_m[row, None]
    )
    counted = along[0] <= length
    counted[: round(_MERGED_S / driven.step_s)] = False
    error = float(np.abs(beside[0][counted]).mean()) if counted.any() else 0.0
    return Measured(
        asked=f"along {words}",
        achieved=f"{error:.1f} m beside it",
        error=error,
        unit="m",
        is_obeyed=error <= OBEYED_PATH_M,
    )


def _target_speed(term: TargetSpeed, driven: Driven) -> Measured | None:
    rows = driven.rows(term.agent_ids, MOTOR_VEHICLE_KINDS)
    speed = driven.speed_mps()[rows]
    if not term.agent_ids:
        # Stationary agents are not moved unless they are named.
        speed = speed[speed.max(axis=1, initial=0.0) > STANDING_MPS]
    if not len(speed):
        return None
    last = speed[:, -max(round(_LAST_S / driven.step_s), 1) :].mean(axis=1)
    worst = last[int(np.abs(last - term.speed_mps).argmax())]
    error = float(abs(worst - term.speed_mps))
    return Measured(
        asked=f"{term.speed_mps:.1f} m/s over the last second",
        achieved=of_several(len(last), f"{worst:.1f} m/s"),
        error=error,
        unit="m/s",
        is_obeyed=error <= OBEYED_SPEED_MPS,
    )


def _speed_limit(term: SpeedLimit, driven: Driven) -> Measured | None:
    rows = driven.rows(term.agent_ids, ROAD_USER_KINDS)
    if not len(rows):
        return None
    speed = driven.speed_mps()[rows]
    allowed = allowed_mps(term.speed_mps, speed, driven.step_s)
    excess = speed - allowed
    worst = float(excess.max())
    is_obeyed = worst <= OBEYED_SPEED_MPS
    row, step = np.unravel_index(excess.argmax(), excess.shape)
    achieved, start = f"at most {speed[row, step]:.1f} m/s", speed[row, 0]
    if is_obeyed:
        achieved = _slowed_to(term.speed_mps, speed, allowed)
    elif start > term.speed_mps:
        achieved += f", {worst:.1f} more than braking from {start:.1f} m/s allows"
    return Measured(
        asked=f"at most {term.speed_mps:.1f} m/s",
        achieved=of_several(len(rows), achieved),
        error=max(worst, 0.0),
        unit="m/s",
        is_obeyed=is_obeyed,
    )


def _slowed_to(
    limit_mps: float,
    speed_mps: Float[np.ndarray, "G S"],
    allowed_mps: Float[np.ndarray, "G S"],
) -> str:
    """The highest speed where no time to brake is allowed, and what was braked from."""
    bound = speed_mps[allowed_mps <= limit_mps]
    fastest = float(speed_mps[:, 0].max())
    if not bound.size:
        return f"still braking from {fastest:.1f} m/s at the end"
    top = f"at most {bound.max():.1f} m/s"
    return top if fastest <= limit_mps else f"{top} once braked from {fastest:.1f} m/s"


def allowed_mps(
    limit_mps: float, speed_mps: Float[np.ndarray, "G S"], step_s: float
) -> Float[np.ndarray, "G S"]:
    """Speeds that keep a limit; the time to brake from the current speed is allowed."""
    time_s = step_s * np.arange(speed_mps.shape[1])
    return np.maximum(limit_mps, speed_mps[:, :1] - LIMIT_BRAKING_MPS2 * time_s)


def _comfort(term: ComfortLimits, driven: Driven) -> Measured | None:
    rows = driven.rows(term.agent_ids, LANE_FOLLOWER_KINDS)
    if not len(rows):
        return None
    motion = kinematics(generated_traffic(driven.scenario, driven.sample))
    along, across = motion.longitudinal_mps2[rows], np.abs(motion.lateral_mps2[rows])
    excess = {
        "acceleration": along.max(axis=1) - term.max_acceleration_mps2,
        "braking": -along.min(axis=1) - term.max_braking_mps2,
        "lateral acceleration": across.max(axis=1) - term.max_lateral_mps2,
    }
    what = max(excess, key=lambda name: excess[name].max())
    error = max(float(excess[what].max()), 0.0)
    worst = driven.sample.ids[rows[excess[what].argmax()]]
    return Measured(
        asked=(
            f"at most {term.max_acceleration_mps2:.1f} forwards, "
            f"{term.max_braking_mps2:.1f} braking, {term.max_lateral_mps2:.1f} m/s2 "
            "sideways"
        ),
        achieved="within all" if error == 0 else f"{error:.1f} m/s2 more {what}",
        error=error,
        unit="m/s2",
        is_obeyed=error <= OBEYED_ACCELERATION_MPS2,
        worst_id=worst if error > 0 else None,
    )


def _stop(term: StopAtLine, driven: Driven) -> Measured | None:
    row = driven.row(term.agent_id)
    if row is None:
        return None
    sample = driven.sample
    beyond = overrun_m(
        sample.position_m[row],
        sample.heading_rad[row],
        sample.size_m[row],
        np.array(term.line_m),
    )
    speed = float(driven.speed_mps()[row, -1])
    stands = speed < 2 * STANDING_MPS
    # An agent that has not come to the line yet can still stop before it, or cannot.
    overrun = beyond if stands else beyond + speed**2 / (2 * MAX_BRAKING_MPS2)
    stops = overrun <= (OBEYED_OVERRUN_M if stands else 0.0)
    if not np.isfinite(beyond):
        achieved = "passes beside the line"
    elif beyond > OBEYED_OVERRUN_M:
        achieved = f"crosses it by {beyond:.1f} m"
        overrun = beyond
    else:
        state = "stands" if stands else f"rolls with {speed:.1f} m/s"
        achieved = f"{state} {max(-beyond, 0.0):.1f} m before it"
        if not stops:
            achieved += ", too fast to stop there"
    return Measured(
        asked="stops before the line",
        achieved=achieved,
        error=max(overrun, 0.0) if np.isfinite(beyond) else 0.0,
        unit="m",
        is_obeyed=bool(stops),
    )


def _on_road(term: StayOnRoad, driven: Driven) -> Measured | None:
    rows = driven.rows(term.agent_ids, LANE_FOLLOWER_KINDS)
    if not len(rows):
        return None
    sample = driven.sample
    steps = slice(0, None, _ROAD_STRIDE)
    position = sample.position_m[rows, steps]
    size = np.broadcast_to(sample.size_m[rows, None], position.shape)
    heading = sample.heading_rad[rows, steps]
    way = way_back_m(driven.scenario, box_corners(position, heading, size), heading)
    outside = np.linalg.norm(way, axis=-1).max(axis=-1)
    # Agents that begin off the road, as on parking lots, are not asked to come back.
    outside = outside[outside[:, 0] == 0]
    worst = float(outside.max(initial=0.0))
    return Measured(
        asked="boxes on the road",
        achieved="on the road" if worst == 0 else f"a corner {worst:.1f} m outside",
        error=worst,
        unit="m",
        is_obeyed=worst <= OBEYED_OUTSIDE_M,
    )


MEASURES: Final[dict[type[GuidanceTerm], Callable[[Any, Driven], Measured | None]]] = {
    GoalPoint: _goal,
    FollowPath: _path,
    FollowLane: _lane,
    TargetSpeed: _target_speed,
    SpeedLimit: _speed_limit,
    ComfortLimits: _comfort,
    StopAtLine: _stop,
    StayOnRoad: _on_road,
    KeepGap: gap_outcome,
    AvoidCollisions: collision_outcome,
    YieldTo: yield_outcome,
    Threaten: threat_measured,
}
"""Measures the terms of each kind; None if none of their agents was generated."""
