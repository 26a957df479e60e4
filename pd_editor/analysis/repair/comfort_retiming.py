"""Retimes trajectories so that braking, acceleration and turning are comfortable."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.motion.kinematics import (
    COMFORT_ACCELERATION_MPS2,
    COMFORT_BRAKING_MPS2,
    COMFORT_LATERAL_MPS2,
    COMFORT_YAW_RATE_RADPS,
    DEGREE,
    WINDOW_STEPS,
    derivative_operators,
    kinematics,
)
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.analysis.repair.repairable import repairable
from pd_editor.analysis.repair.retimed_trajectories import Trajectories
from pd_editor.scene.paths.retiming import highest_speed, slowed_distance
from pd_editor.scene.scenario import Scenario

SHARES: Final = (0.9, 0.75, 0.6, 0.45)
"""Shares of the limits that are tried in turn, until the motion is within the limits."""
_SLOWEST_MPS: Final = 1.0
"""Below this speed the curvature of a recorded path is noise."""


def retime_for_comfort(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
) -> Scenario:
    """Slow lane followers with harsh motion along their own paths.

    Harsh is what the metrics ``uncomfortable`` and ``impossible`` count. Agents brake
    earlier and accelerate later than before, and never run ahead of their timing.
    Current poses stay; a current speed is lowered where the agent could not brake
    comfortably from it. Agents that collide with a slowed one yield if they are among
    ``agent_ids``; else the slowed one keeps its former trajectory, as do agents whose
    motion would still be harsh. ``agent_ids`` None means all; ``keep_ids`` None keeps
    the focal agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    before = Trajectories(
        scenario=scenario,
        may_change=repairable(scenario, agent_ids, keep_ids),
    )
    wanted = np.intersect1d(before.moving_rows(), harsh_rows(scenario))
    return _without_new_conflicts(before, _smoothed(before, wanted)).scenario


def harsh_rows(scenario: Scenario) -> Int[np.ndarray, "G"]:
    """Rows of agents whose motion exceeds a limit of comfort or of physics."""
    view = recorded_traffic(scenario)
    motion = kinematics(view)
    harsh = (motion.is_uncomfortable() | motion.is_impossible()) & motion.is_valid
    names = [view.agents.ids[row] for row in np.flatnonzero(harsh.any(axis=1))]
    return scenario.agents.rows(names)


def _smoothed(before: Trajectories, wanted: Int[np.ndarray, "G"]) -> Trajectories:
    """Slow agents as little as is enough."""
    done = before
    for share in SHARES:
        if not len(wanted):
            break
        tried = _slowed(before, wanted, share)
        is_left = np.isin(wanted, harsh_rows(tried.scenario))
        done = _with_rows_of(done, tried, wanted[~is_left])
        wanted = wanted[is_left]
    return done


def _slowed(
    trajectories: Trajectories, rows: Int[np.ndarray, "G"], share: float
) -> Trajectories:
    """Slow agents to a share of the limits; their paths stay."""
    step_s = trajectories.scenario.time_axis.step_s
    curve, heading, along = trajectories.paths(rows)
    num_steps = along.shape[1]
    window = min(WINDOW_STEPS, num_steps)
    if window <= DEGREE:
        return trajectories
    first, _, _ = derivative_operators(num_steps, window, step_s)
    velocity = first @ curve
    fitted = np.hypot(velocity[..., 0], velocity[..., 1])
    yaw_rate = np.abs((first @ heading[..., None])[..., 0])
    limit = np.minimum(fitted, _turning_limit(fitted, yaw_rate, share))
    allowed = highest_speed(
        along,
        limit,
        braking_mps2=-share * COMFORT_BRAKING_MPS2,
        acceleration_mps2=share * COMFORT_ACCELERATION_MPS2,
    )
    speed = np.gradient(along, step_s, axis=1)
    distance, slowed = slowed_distance(along, speed, allowed, step_s)
    return trajectories.retimed(rows, distance, slowed)


def _turning_limit(
    speed_mps: Float[np.ndarray, "G H"],
    yaw_rate_radps: Float[np.ndarray, "G H"],
    share: float,
) -> Float[np.ndarray, "G H"]:
    """Speed at which the path's curvature is comfortable; infinite where straight."""
    moves = speed_mps > _SLOWEST_MPS
    curvature = np.where(moves, yaw_rate_radps / np.where(moves, speed_mps, 1.0), 0.0)
    bends = curvature > 1e-4
    curvature = np.where(bends, curvature, 1.0)
    sideways = np.sqrt(share * COMFORT_LATERAL_MPS2 / curvature)
    turning = share * COMFORT_YAW_RATE_RADPS / curvature
    return np.where(bends, np.minimum(sideways, turning), np.inf)


def _without_new_conflicts(before: Trajectories, after: Trajectories) -> Trajectories:
    """Let others yield to slowed agents, else restore the slowed ones of new conflicts."""
    known = {tuple(pair) for pair in before.conflicts().tolist()}
    slowed = after.changed

    def new_rows(trajectories: Trajectories) -> set[int]:
        pairs = trajectories.conflicts().tolist()
        return {row for pair in pairs if tuple(pair) not in known for row in pair}

    involved = new_rows(after)
    if not involved:
        return after
    partners: Bool[np.ndarray, "A"] = np.zeros(len(before.agents), bool)
    partners[list(involved - slowed)] = True
    yielding = replace(after, may_change=before.may_change & partners).with_yielding()
    if not new_rows(yielding):
        return yielding
    # Without those that still collide, those that yielded to them need not.
    kept = np.array(sorted(slowed - involved), int)
    return _with_rows_of(before, after, kept)


def _with_rows_of(
    one: Trajectories, other: Trajectories, rows: Int[np.ndarray, "G"]
) -> Trajectories:
    """The first trajectories with some agents' of the second."""
    if not len(rows):
        return one
    agents = other.agents
    changed = one.agents.with_rows(
        rows,
        position_m=agents.position_m[rows],
        heading_rad=agents.heading_rad[rows],
        velocity_mps=agents.velocity_mps[rows],
    )
    return replace(
        one,
        scenario=one.scenario.with_agents(changed),
        changed=one.changed.union(rows.tolist()),
    )
