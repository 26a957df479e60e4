"""Repairs of current states: snap to lanes, separate overlaps, limit speeds to gaps."""

from collections.abc import Iterable
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import overlapping_pairs
from pd_editor.analysis.repair.current_states import (
    SLIDE_REACH_M,
    States,
    counted,
    line_through,
    poses_along,
    repairable,
    slid_poses,
    slides_m,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.paths.retiming import MAX_BRAKING_MPS2
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

MAX_OFFSET_M: Final = 2.0
"""A moving agent within this distance of a centre line is on its lane.

Half of a wide lane: an agent that changes lanes is never further from both.
"""


def project_to_lanes(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    max_offset_m: float = MAX_OFFSET_M,
    moves_stationary: bool = False,
) -> Scenario:
    """Snap moving lane followers that are too far from any lane in their direction.

    They keep their speed and head along the lane; whole tracks move with them.
    Stationary agents stay, since parked ones belong beside lanes, unless
    ``moves_stationary`` is set. If the position on the lane is occupied, the nearest
    free one along it is used. Agents that would overlap more others than before stay.
    ``agent_ids`` None means all.

    Raises:
        EditError: an id is not in the scenario.
    """
    agents, step = scenario.agents, scenario.current_step
    is_meant = repairable(scenario, agent_ids)
    if not moves_stationary:
        is_meant &= agents.speed_mps()[:, step] >= MOVING_MPS
    rows = np.flatnonzero(is_meant)
    states = States.of(scenario)
    # Lanes further away than this are not considered.
    choice = states.lanes(rows, reach_m=15.0)
    off_lane = np.flatnonzero(choice.distance_m > max_offset_m).tolist()
    _place_until_stuck(
        states,
        {int(rows[i]): (int(choice.lane[i]), choice.along_m[i]) for i in off_lane},
    )
    return states.carried()


def _place_until_stuck(states: States, place_of: dict[int, tuple[int, float]]) -> None:
    """Move each row to its lane if possible."""
    left = list(place_of)
    num_left = len(left) + 1
    # A position may become free when another agent is moved.
    while len(left) < num_left:
        num_left = len(left)
        left = [row for row in left if not _put_on_lane(states, row, *place_of[row])]


def _put_on_lane(states: States, row: int, lane: int, along_m: float) -> bool:
    """Move an agent to the nearest free position on its lane; False if there is none."""
    if lane < 0:
        return False
    on_lane = float(np.clip(along_m, 0.0, states.graph.lengths_m[lane]))
    frames, start = line_through(states.graph, lane)
    here = start + on_lane
    position, heading, _ = poses_along(frames, np.array([here]), 0.0)
    now = states.position_m[row][None], states.heading_rad[row][None]
    num_before, num_there = states.num_overlaps(
        row, np.concatenate([now[0], position]), np.append(now[1], heading)
    ).tolist()
    best: int | None = 0
    if num_there > num_before or not states.is_no_worse(row, position)[0]:
        position, heading, is_there = poses_along(frames, here + slides_m(), 0.0)
        position, heading = position[is_there], heading[is_there]
        best = states.first_free(row, position, heading, max_overlaps=num_before)
    if best is None:
        return False
    states.position_m[row] = position[best]
    states.heading_rad[row] = wrap_angle(heading)[best]
    return True


GAP_M: Final = 0.5
"""Gap ahead of and behind an agent that was slid."""


def separate_overlaps(
    scenario: Scenario, agent_ids: Iterable[str] | None = None
) -> Scenario:
    """Slide lane followers that overlap others now to the nearest free position.

    They slide along their lane, or straight without one, by multiples of 0.25 m up to
    20 m, never further off their lane nor off the road; whole tracks move with them. Of
    a pair, the less important agent moves (benchmark category, then the later row), the
    other one only if the first cannot. ``agent_ids`` None means all.

    Raises:
        EditError: an id is not in the scenario.
    """
    may_move = repairable(scenario, agent_ids)
    states, pairs = States.of(scenario), overlaps_now(scenario)
    stuck = np.zeros(len(may_move), bool)
    while len(pairs):
        if not _one_pass(states, pairs, may_move, stuck):
            break
        pairs = overlaps_now(states.carried())
    return states.carried()


def overlaps_now(scenario: Scenario) -> Int[np.ndarray, "P 2"]:
    """Pairs that overlap at the current step and are to be separated."""
    pairs = overlapping_pairs(scenario.agents, scenario.current_step)
    return pairs[counted(scenario.agents, pairs)]


def _one_pass(
    states: States,
    pairs: Int[np.ndarray, "P 2"],
    may_move: Bool[np.ndarray, "A"],
    stuck: Bool[np.ndarray, "A"],
) -> set[int]:
    """Move one agent of each pair if possible; each move separates its pair.

    Agents that find no place are ``stuck`` until one moves away in their reach.
    """
    agents = states.scenario.agents
    rows = np.unique(pairs[may_move[pairs]])
    # Agents within this distance of a lane, including parked ones, slide along it.
    choice = states.lanes(rows, reach_m=6.0)
    lane_of = dict(zip(rows.tolist(), choice.lane.tolist(), strict=True))
    moved: set[int] = set()
    for pair in pairs.tolist():
        if moved & set(pair):
            continue
        for row in sorted(pair, key=lambda one: (agents.categories[one], -one)):
            if not may_move[row] or stuck[row]:
                continue
            before = states.position_m[row].copy()
            stuck[row] = not _slide(states, row, lane_of[row])
            if not stuck[row]:
                moved.add(row)
                apart = np.hypot(*(states.position_m - before).T)
                # Beside a bend an agent goes further than along its lane.
                stuck &= apart > 2 * SLIDE_REACH_M + agents.radius_m.max()
                break
    return moved


def _slide(states: States, row: int, lane: int) -> bool:
    """Move an agent to the nearest free position; False if there is none."""
    position, heading = slid_poses(
        states.graph,
        lane,
        states.position_m[row],
        float(states.heading_rad[row]),
        slides_m(),
    )
    best = states.first_free(row, position, heading, gap_m=GAP_M)
    if best is None:
        return False
    states.position_m[row], states.heading_rad[row] = position[best], heading[best]
    return True


STANDING_GAP_M: Final = 0.5
"""Gap between two stationary agents in line."""
_TOUCH_M: Final = 0.1
"""Agents that reach no further than this into the strip ahead do not block it."""


def slow_for_gaps(
    scenario: Scenario, agent_ids: Iterable[str] | None = None
) -> Scenario:
    """Limit the current speeds of lane followers to the gaps ahead of them.

    Ahead is the strip that an agent sweeps when it drives straight on. With a gap g to
    an agent with speed u in its direction, its speed is at most sqrt(u^2 + 2 b g), b
    being the hardest braking of candidates. Only current velocities change: this is for
    agents that have just been placed. ``agent_ids`` None means all.

    Raises:
        EditError: an id is not in the scenario.
    """
    may_change = repairable(scenario, agent_ids)
    if not may_change.any():
        return scenario
    agents, step = scenario.agents, scenario.current_step
    velocity = agents.velocity_mps[:, step]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    gap = gaps_ahead_m(agents, step)
    slowed = _slowed(gap, agents.heading_rad[:, step], velocity, may_change)
    rows = np.flatnonzero(speed - slowed > 0.01)
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
    # Limit of iterations: a queue takes one per agent, rings without gaps take many.
    for _ in range(1000):
        allowed = np.sqrt((along * speed) ** 2 + braking)
        new = np.where(may_change, np.minimum(speed, allowed.min(axis=1)), speed)
        is_done = np.allclose(new, speed, rtol=0, atol=1e-5)
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
