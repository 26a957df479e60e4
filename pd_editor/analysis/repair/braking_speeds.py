"""Limits current speeds so that agents can brake behind the agent ahead."""

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.repair.repairable import counted, repairable
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.paths.speed_profiles import MAX_BRAKING_MPS2
from pd_editor.scene.scenario import Scenario

STANDING_GAP_M: Final = 0.5
"""Gap between two stationary agents in line."""
_TOUCH_M: Final = 0.1
"""Agents that reach no further than this into the strip ahead do not block it."""
_LEAST_CHANGE_MPS: Final = 0.01
_SETTLED_MPS: Final = 1e-5
_MOST_ROUNDS: Final = 1000
"""Limit of iterations: a queue takes one per agent, rings without gaps take many."""


def slow_for_gaps(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
) -> Scenario:
    """Limit the current speeds of lane followers to the gaps ahead of them.

    Ahead is the strip that an agent sweeps when it drives straight on. With a gap g to
    an agent with speed u in its direction, its speed is at most sqrt(u^2 + 2 b g), b
    being the hardest braking of candidates. Only current velocities change: this is for
    agents that have just been placed. ``agent_ids`` None means all; ``keep_ids`` None
    keeps the focal agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    may_change = repairable(scenario, agent_ids, keep_ids)
    if not may_change.any():
        return scenario
    agents, step = scenario.agents, scenario.current_step
    velocity = agents.velocity_mps[:, step]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    gap = gaps_ahead_m(agents, step)
    slowed = _slowed(gap, agents.heading_rad[:, step], velocity, may_change)
    rows = np.flatnonzero(speed - slowed > _LEAST_CHANGE_MPS)
    if not len(rows):
        return scenario
    later = agents.velocity_mps[rows].copy()
    later[:, step] *= (slowed[rows] / speed[rows])[:, None]
    return scenario.with_agents(agents.with_rows(rows, velocity_mps=later))


def _slowed(
    gap_m: Float[np.ndarray, "A A"],
    heading_rad: Float[np.ndarray, "A"],
    velocity_mps: Float[np.ndarray, "A 2"],
    may_change: Bool[np.ndarray, "A"],
) -> Float[np.ndarray, "A"]:
    """Speeds that the gaps allow.

    A slowed agent may slow agents behind it, so limits are iterated until nothing
    changes. Two agents in each other's strip treat each other as stationary.
    """
    forward = unit_vector(heading_rad)
    speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    braking = 2 * MAX_BRAKING_MPS2 * np.maximum(gap_m - STANDING_GAP_M, 0.0)
    # Component of each agent's speed in the direction of the agent behind it.
    along = velocity_mps @ forward.T / np.maximum(speed, 1e-9)[:, None]
    is_mutual = np.isfinite(gap_m) & np.isfinite(gap_m.T)
    along = np.where(is_mutual, 0.0, np.maximum(along.T, 0.0))
    for _ in range(_MOST_ROUNDS):
        allowed = np.sqrt((along * speed) ** 2 + braking)
        new = np.where(may_change, np.minimum(speed, allowed.min(axis=1)), speed)
        is_done = np.allclose(new, speed, rtol=0, atol=_SETTLED_MPS)
        speed = new
        if is_done:
            break
    return speed


def gaps_ahead_m(agents: AgentTracks, step: int) -> Float[np.ndarray, "A A"]:
    """Gap of each agent to each agent in its strip; infinite to all others."""
    position, heading = agents.position_m[:, step], agents.heading_rad[:, step]
    length, width = agents.size_m.T
    forward = unit_vector(heading)
    offset = position[None] - position[:, None]
    along = np.einsum("abd,ad->ab", offset, forward)
    aside = offset[..., 1] * forward[:, :1] - offset[..., 0] * forward[:, 1:]
    matters = (along > 0) & (np.abs(aside) < width[:, None] / 2 + agents.radius_m)
    pairs = np.argwhere(matters & agents.is_valid[:, step])
    own, other = pairs[counted(agents, pairs)].T
    turn = heading[other] - heading[own]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    reach = (length[other] * cos + width[other] * sin) / 2
    side = (length[other] * sin + width[other] * cos) / 2
    there = np.abs(aside[own, other]) < width[own] / 2 + side - _TOUCH_M
    gap = np.full(along.shape, np.inf)
    gap[own[there], other[there]] = (along[own, other] - length[own] / 2 - reach)[there]
    return gap
