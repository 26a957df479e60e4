"""Computes all metrics of a scene, and the profile of an agent over time.

Values that depend on the map only (lane graph, distances between lanes, map points,
drivable area) are cached as long as the map value lives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.metrics.box_overlaps import (
    actor_collision_2m,
    box_overlap,
    init_collision_2m,
    init_five_circles,
    local_density,
    nearest_distance,
)
from pd_editor.analysis.metrics.lanes import (
    lane_deviation,
    nearest_edge,
    off_lane_values,
)
from pd_editor.analysis.metrics.likelihoods import likelihood_values
from pd_editor.analysis.metrics.motion import (
    DEGREE,
    WINDOW_STEPS,
    ade,
    ade_with_state,
    best_of_samples,
    derivative_operators,
    diversity_values,
    fde,
    kinematics,
    missed,
    motion_values,
)
from pd_editor.analysis.metrics.road import askew, surroundings
from pd_editor.analysis.metrics.safety import box_gap_m, safety_values
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.scenario import Scenario


def agent_values(view: TrafficView) -> dict[str, MetricValues]:
    """All metrics of one sample by name.

    Each has a row per evaluated agent: [A], but [A 5] for ``local_density``,
    [A F] for ``surroundings``, and [A H]
    for the accelerations, ``jerk`` and ``yaw_rate``.
    """
    overlap, motion = box_overlap(view), kinematics(view)
    singles = (
        init_collision_2m(view),
        actor_collision_2m(view),
        overlap.at_state(),
        init_five_circles(view),
        overlap.newly(),
        overlap.new_steps(),
        *nearest_edge(view),
        nearest_distance(view),
        local_density(view),
        *askew(view),
        surroundings(view),
        ade_with_state(view),
        ade(view),
        fde(view),
        missed(view),
    )
    return {
        **{values.name: values for values in singles},
        **off_lane_values(view),
        **lane_deviation(view).values(),
        **motion_values(view),
        **motion.per_step(),
        **motion.values(),
        **safety_values(view),
    }


def sample_values(views: Sequence[TrafficView]) -> dict[str, MetricValues]:
    """Metrics of several samples of the same agents by name, with a row per agent."""
    return {
        **best_of_samples(views),
        **diversity_values(views),
        **likelihood_values(views),
    }


NUM_NEAREST: Final = 6
"""Other agents, nearest by their centres, among which the least gap is searched."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentProfile:
    """Motion of an agent at all T steps of a scenario; NaN where it is not there."""

    agent_id: str
    time_s: Float[np.ndarray, "T"]
    """Relative to the current step."""
    speed_mps: Float[np.ndarray, "T"]
    acceleration_mps2: Float[np.ndarray, "T"]
    """Along the heading, of cubics fitted over two seconds as in ``kinematics``.

    NaN also within a second of where a recorded track begins or ends: a fit is worst at
    its ends, and so are the positions of a tracker.
    """
    gap_m: Float[np.ndarray, "T"]
    """Distance between its box and the nearest other road user's."""


def agent_profile(scenario: Scenario, agent_id: str) -> AgentProfile:
    """Motion of an agent.

    Raises:
        EditError: the agent is not in the scenario.
    """
    agents, axis = scenario.agents, scenario.time_axis
    (row,) = agents.rows([agent_id])
    there = agents.is_valid[row]
    speed = np.where(there, np.hypot(*agents.velocity_mps[row].T), np.nan)
    return AgentProfile(
        agent_id=agent_id,
        time_s=axis.times_s() - axis.times_s()[axis.current_step],
        speed_mps=speed,
        acceleration_mps2=acceleration_of(scenario, int(row)),
        gap_m=_gap(scenario, int(row)),
    )


def acceleration_of(scenario: Scenario, row: int) -> Float[np.ndarray, "T"]:
    """``AgentProfile.acceleration_mps2`` of one row: fitted in each stretch without gaps."""
    agents, axis = scenario.agents, scenario.time_axis
    there = agents.is_valid[row]
    found = np.full(len(there), np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    for start, end in edges.reshape(-1, 2).tolist():
        window = min(WINDOW_STEPS, end - start)
        if window <= DEGREE:
            continue
        _, second, _ = derivative_operators(end - start, window, axis.step_s)
        heading = agents.heading_rad[row, start:end]
        forward = unit_vector(heading)
        vector = second @ agents.position_m[row, start:end]
        first = 0 if start == axis.current_step else window // 2
        inner = slice(start + first, end - window // 2)
        found[inner] = (vector * forward).sum(axis=-1)[
            first : end - start - window // 2
        ]
    return found


def _gap(scenario: Scenario, row: int) -> Float[np.ndarray, "T"]:
    agents = scenario.agents
    others = np.flatnonzero(agents.kind_mask(ROAD_USER_KINDS))
    others = others[others != row]
    found = np.full(agents.num_steps, np.nan)
    both = agents.is_valid[others] & agents.is_valid[row]
    if not both.any():
        return found
    offset = agents.position_m[others] - agents.position_m[row]
    radius = np.hypot(*agents.size_m[others].T)[:, None] / 2
    least = np.where(both, np.hypot(offset[..., 0], offset[..., 1]) - radius, np.inf)
    nearest = np.argsort(least, axis=0)[:NUM_NEAREST]
    step = np.broadcast_to(np.arange(agents.num_steps), nearest.shape)
    is_there = both[nearest, step]
    index, step = nearest[is_there], step[is_there]
    gap = box_gap_m(agents.at(row, step), agents.at(others[index], step))
    least_gap = np.full(agents.num_steps, np.inf)
    np.minimum.at(least_gap, step, gap)
    return np.where(np.isfinite(least_gap), least_gap, np.nan)
