"""Outcomes of terms on pairs of agents: gaps, collisions, yielding, threats."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.findings.collisions import later_collisions
from pd_editor.analysis.guidance.limits import (
    MAX_BRAKING_MPS2,
    OBEYED_GAP_M,
    OPENING_MPS,
)
from pd_editor.analysis.guidance.measured import Driven, Measured, of_several
from pd_editor.analysis.metrics.collisions.box_collision import box_overlap
from pd_editor.analysis.metrics.collisions.box_tests import boxes_touch
from pd_editor.analysis.metrics.traffic_view import generated_traffic, whole_traffic
from pd_editor.analysis.threats.encounter import Track, encounter
from pd_editor.analysis.threats.threat_feasibility import (
    recorded_track,
    threat_obstacle,
)
from pd_editor.analysis.threats.threat_outcome import obstacle_in_words, threat_in_words
from pd_editor.analysis.threats.threat_plans import ThreatAim
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import BoxStates
from pd_editor.scene.guidance_terms import AvoidCollisions, KeepGap, Threaten, YieldTo

_FOLLOWS_COS: Final = 0.5
"""A leader's heading differs by less than 60 degrees."""


def gap_outcome(term: KeepGap, driven: Driven) -> Measured | None:
    """Least gap to the agent ahead, where it could have been the asked one."""
    rows = driven.rows(term.agent_ids, LANE_FOLLOWER_KINDS)
    if not len(rows):
        return None
    view = generated_traffic(driven.scenario, driven.sample)
    gap, first = gaps_ahead(view.everyone, rows)
    time_s = driven.step_s * np.arange(gap.shape[1])
    asked = np.minimum(np.minimum(first, term.gap_m) + OPENING_MPS * time_s, term.gap_m)
    missing = np.where(np.isfinite(gap), asked - gap, -np.inf)
    short = np.minimum(missing, _could_wait_m(view.everyone, rows, time_s))[:, 1:]
    words = f"at least {term.gap_m:.1f} m to the agent ahead"
    if not np.isfinite(short).any():
        return Measured(
            asked=words, achieved="no agent ahead", error=0.0, unit="m", is_obeyed=True
        )
    worst = max(float(short.max()), 0.0)
    is_obeyed = worst <= OBEYED_GAP_M
    row, step = np.unravel_index(short.argmax(), short.shape)
    least = gap[row, step + 1]
    achieved = f"{least:.1f} m"
    if is_obeyed and least < term.gap_m - OBEYED_GAP_M:
        opens = missing[row, 1:].max() <= OBEYED_GAP_M
        achieved += (
            f", opening from {first[row, step + 1]:.1f} m"
            if opens
            else ", and could not leave more"
        )
    follows = int(np.isfinite(gap).any(axis=1).sum())
    return Measured(
        asked=words,
        achieved=of_several(follows, achieved),
        error=worst,
        unit="m",
        is_obeyed=is_obeyed,
    )


def _could_wait_m(
    agents: AgentStates, rows: Int[np.ndarray, "G"], time_s: Float[np.ndarray, "H"]
) -> Float[np.ndarray, "G H"]:
    """How much less agents could have driven: they brake at most, and do not reverse."""
    way = np.linalg.norm(np.diff(agents.position_m[rows], axis=1), axis=-1)
    speed = np.hypot(*agents.velocity_mps[rows, 0].T)[:, None]
    lasts = np.minimum(time_s, speed / MAX_BRAKING_MPS2)
    least = speed * lasts - MAX_BRAKING_MPS2 / 2 * lasts**2
    return np.maximum(np.pad(way.cumsum(axis=1), [(0, 0), (1, 0)]) - least, 0.0)


def gaps_ahead(
    agents: BoxStates, rows: Int[np.ndarray, "G"]
) -> tuple[Float[np.ndarray, "G H"], Float[np.ndarray, "G H"]]:
    """Gap to the leader at each step, and its gap at the current step; else infinite.

    The leader is the nearest agent ahead in the corridor of the agent's box, with about
    the same heading, that is not beside it then and now.
    """
    forward = unit_vector(agents.heading_rad[rows])[:, None]
    offset = agents.position_m[None] - agents.position_m[rows, None]
    ahead = (offset * forward).sum(-1)
    aside = np.abs((offset * left_of(forward)).sum(-1))
    turn = agents.heading_rad[None] - agents.heading_rad[rows, None]
    cos, sin = np.cos(turn), np.abs(np.sin(turn))
    length, width = agents.size_m.T[:, None, :, None] / 2
    half = length * np.abs(cos) + width * sin
    wide = width * np.abs(cos) + length * sin
    mine = agents.size_m[rows, None, None] / 2
    leads = (aside < wide + mine[..., 1]) & (cos > _FOLLOWS_COS)
    leads &= (ahead > mine[..., 0]) & agents.is_valid[None]
    gap = ahead - half - mine[..., 0]
    leads &= (gap > 0) | (gap[..., :1] > 0)
    first = np.maximum(gap[..., 0], 0.0)
    gap = np.where(leads, gap, np.inf)
    leader = gap.argmin(axis=1)
    return gap.min(axis=1, initial=np.inf), np.take_along_axis(first, leader, axis=1)


def collision_outcome(term: AvoidCollisions, driven: Driven) -> Measured | None:
    """Number of agents that collide after t = 0, but not at t = 0 already."""
    rows = driven.rows(term.agent_ids, ROAD_USER_KINDS)
    if not len(rows):
        return None
    newly = box_overlap(generated_traffic(driven.scenario, driven.sample)).newly()
    count = int((newly.value.astype(bool) & newly.is_valid)[rows].sum())
    agents = "agent collides" if count == 1 else "agents collide"
    return Measured(
        asked="no collision after t = 0",
        achieved=f"{count} {agents}" if count else "no collision after t = 0",
        error=float(count),
        unit="agents",
        is_obeyed=count == 0,
    )


def yield_outcome(term: YieldTo, driven: Driven) -> Measured | None:
    """Time between the agents at the places where both have been."""
    first, second = track_of(driven, term.agent_id), track_of(driven, term.other_id)
    if driven.row(term.agent_id) is None or first is None or second is None:
        return None
    asked = f"passes after agent {term.other_id}"
    place, time = np.nonzero(shared_places(first, second))
    if not len(place):
        return Measured(
            asked=asked,
            achieved=f"stays clear of the path of agent {term.other_id}",
            error=0.0,
            unit="s",
            is_obeyed=True,
            has_no_case=True,
        )
    after_s = float((place - time).min()) * driven.step_s
    achieved = (
        f"{after_s:.1f} s after it" if after_s > 0 else f"{-after_s:.1f} s before it"
    )
    return Measured(
        asked=asked,
        achieved=achieved,
        error=max(-after_s, 0.0),
        unit="s",
        is_obeyed=after_s > 0,
    )


def shared_places(first: Track, second: Track) -> Bool[np.ndarray, "H H"]:
    """Whether the box of one agent at a step is where the other one's is at another."""
    count = len(first.position_m)
    place, time = (one.ravel() for one in np.indices((count, count)))
    touches = boxes_touch(first.at(place), second.at(time))
    return touches.reshape(count, count)


def threat_measured(term: Threaten, driven: Driven) -> Measured | None:
    """Encounter of the agent that threatens with the one that is threatened."""
    first, second = track_of(driven, term.agent_id), track_of(driven, term.other_id)
    if driven.row(term.agent_id) is None or first is None or second is None:
        return None
    found = encounter(first, second, driven.step_s, term.approach)
    aim = ThreatAim.of(term.approach, term.severity)
    words = threat_in_words(aim, found)
    until = round(found.at_s / driven.step_s)
    hit = _first_hit(driven, term, until)
    achieved, obstacle = words.achieved, None
    if hit is not None:
        achieved += f", but hits {hit[0]} after {hit[1]:.1f} s"
    if not words.is_met:
        ids = driven.sample.ids
        obstacle = threat_obstacle(driven.scenario, term, (second,), ids)
    if obstacle is not None:
        other, duration_s = f"agent {term.other_id}", driven.step_s * driven.num_steps
        why = obstacle_in_words(obstacle, term.approach, other, duration_s)
        achieved += f"; as {other} moves, {why}"
    elif not words.is_met and hit is None:
        achieved += "; the model can drive none of the ways that meet it"
    return Measured(
        asked=words.asked,
        achieved=achieved,
        error=words.error_m,
        unit="m",
        is_obeyed=words.is_met and hit is None,
        is_feasible=obstacle is None,
    )


def _first_hit(driven: Driven, term: Threaten, until: int) -> tuple[str, float] | None:
    """What the agent that threatens hits first besides the other one, up to a step."""
    everyone = whole_traffic(driven.scenario, driven.sample)
    pairs, begins = later_collisions(everyone.from_step(driven.scenario.current_step))
    own = everyone.ids.index(term.agent_id)
    others = np.where(pairs[:, 0] == own, pairs[:, 1], pairs[:, 0])
    counted = (pairs == own).any(axis=1) & (begins <= until)
    for row in np.flatnonzero(counted)[np.argsort(begins[counted], kind="stable")]:
        if everyone.ids[others[row]] != term.other_id:
            return everyone.ids[others[row]], float(begins[row]) * driven.step_s
    return None


def track_of(driven: Driven, agent_id: str) -> Track | None:
    """Trajectory of an agent, generated or recorded; None if it is not there at t = 0."""
    scenario, sample, row = driven.scenario, driven.sample, driven.row(agent_id)
    if row is None:
        known = scenario.agents.row_of.get(agent_id)
        is_there = scenario.agents.is_valid[:, scenario.current_step]
        if known is None or not is_there[known]:
            return None
        return recorded_track(scenario, known)
    return Track(
        position_m=sample.position_m[row],
        heading_rad=sample.heading_rad[row],
        velocity_mps=sample.velocity_mps[row],
        size_m=sample.size_m[row],
    )
