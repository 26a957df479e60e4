"""Findings on agents above the friction limit in curves: v^2 |kappa| > mu g."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.findings.finding import Finding, at_time, finding_of_agent
from pd_editor.analysis.metrics.motion import (
    WINDOW_STEPS,
    derivative_operators,
    whole_windows,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.paths.retiming import fill_gaps, slowed_to_limits
from pd_editor.scene.perturbation.friction import (
    BRAKING_MPS2,
    DRY_ROAD_FRICTION,
    GRAVITY_MPS2,
)
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2, STATIONARY_M

TOLERANCE: Final = 1.25
"""Ratio of acceleration to limit up to which an agent is not reported.

Curvatures of noisy paths are known to about a tenth: agents that were slowed to the
limit, as measured elsewhere, must not be reported.
"""
_NODES_PER_STEP: Final = 4
_SLOWEST_MPS: Final = 2.0
"""Below this speed a recorded path is too noisy to measure curvature."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SidewaysMotion:
    """Lateral motion of G agents at S steps, the current one first."""

    rows: Int[np.ndarray, "G"]
    speed_mps: Float[np.ndarray, "G S"]
    lateral_mps2: Float[np.ndarray, "G S"]
    """Largest lateral acceleration from a step to the next one; zero if unknown."""


def friction_coefficient_of(scenario: Scenario) -> float:
    """Friction coefficient that agents were slowed to, or that of a dry road."""
    mu = scenario.friction_coefficient
    return DRY_ROAD_FRICTION if mu is None else mu


def sideways_motion(scenario: Scenario) -> SidewaysMotion:
    """Lateral accelerations of moving vehicles, buses, motorcyclists and cyclists.

    The motion without warps is smoothed by cubics over two seconds because recorded
    positions are noisy; the contribution of the warps, which is often shorter than that,
    is exact. An export knows its warps, so it is measured alike.
    """
    agents, now = scenario.agents, scenario.current_step
    rows = np.flatnonzero(agents.kind_mask(LANE_FOLLOWER_KINDS))
    is_valid = agents.is_valid[rows, now:]
    path = fill_gaps(agents.position_m[rows, now:], is_valid)
    rows = rows[
        np.linalg.norm(path - path[:, :1], axis=-1).max(axis=1, initial=0)
        > STATIONARY_M
    ]
    is_valid = agents.is_valid[rows]
    position, warps = agents.position_m[rows], scenario.warps
    for warp in warps[::-1]:
        position = warp.undo(position)
    position = fill_gaps(position, is_valid)
    step_s = scenario.time_axis.step_s
    # The past improves the estimate at the current step, unless an edit made a jump
    # there; agents without a past are evaluated from the current step on.
    whole = _derivatives(position, is_valid, step_s)
    future = _derivatives(position[:, now:], is_valid[:, now:], step_s)
    velocity, acceleration, known = (
        np.stack([one[:, now:], other])
        for one, other in zip(whole, future, strict=True)
    )
    speed, lateral = _under_warps(position[:, now:], velocity, acceleration, warps)
    # If the road bends between two steps, the sharpest point counts.
    nodes = lateral.reshape(*known.shape, _NODES_PER_STEP).max(axis=-1)
    least = np.where(known, nodes, np.inf).min(axis=0)
    # A track whose own speeds are as slow jumps; its path does not tell its speed.
    least[agents.speed_mps()[rows, now:] <= _SLOWEST_MPS] = 0.0
    return SidewaysMotion(
        rows=rows,
        speed_mps=speed[1, :, ::_NODES_PER_STEP],
        lateral_mps2=np.where(np.isfinite(least), least, 0.0),
    )


def friction_problems(scenario: Scenario) -> list[Finding]:
    """Find agents above the friction limit from the current step on."""
    agents, now = scenario.agents, scenario.current_step
    motion, mu = sideways_motion(scenario), friction_coefficient_of(scenario)
    limit = mu * GRAVITY_MPS2
    over = motion.lateral_mps2 > TOLERANCE * limit
    found = []
    # Shorter excesses count as noise.
    for index in np.flatnonzero(over.sum(axis=1) >= 2).tolist():
        row, steps = int(motion.rows[index]), np.flatnonzero(over[index])
        worst = int(motion.lateral_mps2[index].argmax())
        lateral = float(motion.lateral_mps2[index, worst])
        # The same velocity that the view and the panel show.
        speed = float(np.hypot(*agents.velocity_mps[row, worst + now]))
        held = speed * float(np.sqrt(limit / lateral))
        found.append(
            finding_of_agent(
                scenario,
                "friction",
                row,
                steps + now,
                value=lateral,
                limit=limit,
                worst=worst + now,
                words=(
                    f": {speed:.1f} m/s, friction holds {held:.1f}",
                    "is too fast for its curve"
                    f" {_when(scenario, int(steps[0]) + now, worst + now)}:"
                    f" {speed:.1f} m/s, where friction holds {held:.1f} m/s"
                    f" (mu {mu:.2f}).",
                ),
            )
        )
    return found


def _when(scenario: Scenario, first: int, worst: int) -> str:
    """Describe the first time of the excess, and the time of the given figures."""
    at_worst = at_time(scenario, worst)
    if worst == first:
        return at_worst
    since = at_time(scenario, first).removeprefix("at ")
    return f"from {since} on, most {at_worst}"


def slowed_to_limit(
    scenario: Scenario, agent_ids: tuple[str, ...], friction_coefficient: float
) -> AgentTracks:
    """Retime agents along their own paths to the friction limit.

    They brake ahead of a curve and accelerate after it. Current positions stay; a
    current speed is lowered if a curve is too near.

    Raises:
        EditError: an id is not in the scenario.
    """
    wanted = set(scenario.agents.rows(agent_ids).tolist())
    limit = friction_coefficient * GRAVITY_MPS2
    for _ in range(6):
        motion = sideways_motion(scenario)
        fast = (motion.lateral_mps2 > limit).any(axis=1)
        fast &= np.isin(motion.rows, list(wanted))
        if not fast.any():
            break
        agents = _one_pass(scenario, motion, np.flatnonzero(fast), limit)
        scenario = scenario.with_agents(agents)
    return scenario.agents


def _one_pass(
    scenario: Scenario,
    motion: SidewaysMotion,
    some: Int[np.ndarray, "F"],
    limit_mps2: float,
) -> AgentTracks:
    agents, now = scenario.agents, scenario.current_step
    step_s, rows = scenario.time_axis.step_s, motion.rows[some]
    lateral = motion.lateral_mps2[some]
    # The sharpest point between two steps may be assigned to either of them.
    lateral[:, 1:] = np.maximum(lateral[:, 1:], lateral[:, :-1])
    allowed = np.where(
        lateral > 0,
        motion.speed_mps[some]
        * np.sqrt(0.97 * limit_mps2 / np.where(lateral > 0, lateral, 1.0)),
        np.inf,
    )
    later, _ = slowed_to_limits(
        agents.position_m[rows, now:],
        agents.heading_rad[rows, now:],
        agents.is_valid[rows, now:],
        # Ratio of new speed to limit: retiming moves the points at which curvature is
        # measured.
        0.98 * allowed,
        step_s,
        braking_mps2=BRAKING_MPS2,
        acceleration_mps2=FIRM_ACCELERATION_MPS2,
    )
    return agents.with_motion(rows, now, later)


def _derivatives(
    position_m: Float[np.ndarray, "G S 2"],
    is_valid: Bool[np.ndarray, "G S"],
    step_s: float,
) -> tuple[
    Float[np.ndarray, "G S 2"], Float[np.ndarray, "G S 2"], Bool[np.ndarray, "G S"]
]:
    """Velocity and acceleration of fitted cubics, and whether they are known."""
    first, second, _ = derivative_operators(position_m.shape[1], WINDOW_STEPS, step_s)
    known = whole_windows(is_valid, WINDOW_STEPS)
    return first @ position_m, second @ position_m, known


def _under_warps(
    position_m: Float[np.ndarray, "G S 2"],
    velocity_mps: Float[np.ndarray, "E G S 2"],
    acceleration_mps2: Float[np.ndarray, "E G S 2"],
    warps: Iterable[RoadWarp],
) -> tuple[Float[np.ndarray, "E G K"], Float[np.ndarray, "E G K"]]:
    """Speed and lateral acceleration after warps, at several times between two steps.

    With v the velocity before and J = [[1, 0], [f', 1]] the velocity after is J v and
    the acceleration J a + (0, f'' vx^2); lateral is their cross product over the speed.
    J preserves areas, and therefore cross products. Each motion has E estimates.
    """
    position, velocity, acceleration = (
        _between(values) for values in (position_m, velocity_mps, acceleration_mps2)
    )
    cross = (
        velocity[..., 0] * acceleration[..., 1]
        - velocity[..., 1] * acceleration[..., 0]
    )
    for warp in warps:
        forward, left = warp.anchor.turn(np.eye(2))
        x, ahead = warp.distance_ahead(position), velocity @ forward
        cross = cross + warp.derivative(x, 2) * ahead**3
        velocity = velocity + (warp.derivative(x, 1) * ahead)[..., None] * left
        position = warp.apply(position)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    moving: Bool[np.ndarray, "E G K"] = speed > _SLOWEST_MPS
    return speed, np.where(moving, np.abs(cross) / np.where(moving, speed, 1.0), 0.0)


def _between(values: Float[np.ndarray, "*e S D"]) -> Float[np.ndarray, "*e K D"]:
    """Interpolate values at several times after each step; the last step is repeated."""
    share = (np.arange(_NODES_PER_STEP) / _NODES_PER_STEP)[:, None]
    after = np.concatenate([values[..., 1:, :], values[..., -1:, :]], axis=-2)
    nodes = values[..., None, :] + share * (after - values)[..., None, :]
    *rows, num_steps, size = values.shape
    return nodes.reshape(*rows, num_steps * _NODES_PER_STEP, size)
