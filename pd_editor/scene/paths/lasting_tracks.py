"""Tracks that last: what is assumed of an agent where its recording has gaps, or ends.

All that compares an agent with another one's trajectory (feasibility, plans, guidance,
reports) takes the other's track from here, so that they assume the same.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.paths.candidate_grid import Start, plan_paths
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario


def lasting(scenario: Scenario, agent_ids: Iterable[str]) -> Scenario:
    """The scenario in which some agents' tracks last from the current step to the end.

    Gaps are bridged linearly; after its last recorded step an agent drives on along its
    natural path at its last speed. Agents that are not there at the current step stay as
    they are.
    """
    agents, now = scenario.agents, scenario.current_step
    rows = {agents.row_of[name] for name in agent_ids if name in agents.row_of}
    is_valid = agents.is_valid
    short = [r for r in rows if is_valid[r, now] and not is_valid[r, now:].all()]
    step_s = scenario.time_axis.step_s
    for row in sorted(short):
        agents = _lasting(scenario.road_map, agents, now, step_s, row)
    return replace(scenario, agents=agents) if short else scenario


@lru_cache(maxsize=64)
def _lasting(
    road_map: RoadMap, agents: AgentTracks, now: int, step_s: float, row: int
) -> AgentTracks:
    """Cached by identity: tasks and reports of one scene meet the same tracks again."""
    known = now + np.flatnonzero(agents.is_valid[row, now:])
    last = int(known[-1])
    later = np.arange(last + 1, agents.num_steps)
    position = _bridged(agents.position_m[row], known)
    velocity = _bridged(agents.velocity_mps[row], known)
    heading = agents.heading_rad[row, :, None].copy()
    heading[known] = np.unwrap(heading[known], axis=0)
    heading = _bridged(heading, known)[:, 0]
    if len(later):
        start = Start.at(agents, last, np.array([row]))
        plans = plan_paths(road_map, start, step_s * len(later))
        way = start.speed_mps[:, None] * step_s * (later - last)
        natural = np.array([int(np.argmin(plans.role))])
        (position[later],), (heading[later],) = plans.paths.pose_at(natural, way)
        velocity[later] = np.diff(position[last:], axis=0) / step_s
    return agents.with_rows(
        np.array([row]),
        position_m=position,
        heading_rad=wrap_angle(heading),
        velocity_mps=velocity,
        is_valid=agents.is_valid[row] | (np.arange(agents.num_steps) >= now),
    )


def _bridged(
    values: Float[np.ndarray, "T D"], known: Int[np.ndarray, "N"]
) -> Float[np.ndarray, "T D"]:
    """Values with linear ones between the known steps, and the last one after them."""
    steps = np.arange(known[0], len(values))
    bridged = values.copy()
    for axis in range(values.shape[1]):
        bridged[steps, axis] = np.interp(steps, known, values[known, axis])
    return bridged
