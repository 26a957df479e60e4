"""Yielding: agents that would still collide slow down on their own paths."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.speed import ComfortLimits, StopAtLine
from pd_editor.analysis.repair import yield_to_others
from pd_editor.generation.trajectory.guidance.threat_run import threats_in_force
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario


def with_yielding(
    scenario: Scenario,
    rows: Int[np.ndarray, "G"],
    sample: TrafficSample,
    terms: Sequence[GuidanceTerm] = (),
) -> tuple[TrafficSample, tuple[str, ...]]:
    """Slow agents of a sample that would collide later along their own paths.

    ``rows`` are the sample's agents in the scenario; others move as recorded. Late agents
    that continue the track of a sampled one are no obstacles. Current states stay. Agents
    that threaten others, and those, do not yield; agents that are to be somewhere yield
    last, so that they still get there; agents with comfort limits keep them where that
    is enough. Also returns the ids of the agents that yield.
    """
    now, agents = scenario.current_step, scenario.agents
    driven = agents.with_rows(
        rows,
        position_m=_from_now(agents.position_m, rows, now, sample.position_m),
        heading_rad=_from_now(agents.heading_rad, rows, now, sample.heading_rad),
        velocity_mps=_from_now(agents.velocity_mps, rows, now, sample.velocity_mps),
        is_valid=_from_now(
            agents.is_valid, rows, now, np.ones(sample.heading_rad.shape, bool)
        ),
    )
    late = LateAgents.of(scenario)
    doubles = np.setdiff1d(late.row, late.but_continuing(rows).row)
    if len(doubles):
        driven = driven.with_rows(doubles, is_valid=np.array(False))
    waiting, ids = yield_to_others(
        scenario.with_agents(driven),
        sample.ids,
        keep_ids={
            name
            for one in threats_in_force(terms)
            for name in one.named_ids
            if name in agents.row_of
        },
        last_ids={
            one.agent_id
            for one in terms
            if isinstance(one, GoalPoint | StopAtLine) and one.is_on
        },
        comfort_mps2=_comfort_limits(sample, terms),
    )
    if not ids:
        return sample, ()
    after = waiting.agents
    return replace(
        sample,
        position_m=after.position_m[rows, now:],
        heading_rad=after.heading_rad[rows, now:],
        velocity_mps=after.velocity_mps[rows, now:],
    ), ids


def _comfort_limits(
    sample: TrafficSample, terms: Sequence[GuidanceTerm]
) -> dict[str, tuple[float, float]]:
    """Hardest acceleration and braking of agents with comfort limits."""
    found: dict[str, tuple[float, float]] = {}
    drivers = tuple(
        name
        for name, kind in zip(sample.ids, sample.kinds, strict=True)
        if kind in LANE_FOLLOWER_KINDS
    )
    for term in terms:
        if isinstance(term, ComfortLimits) and term.is_in_force:
            for name in set(term.agent_ids or drivers) & set(sample.ids):
                most, hardest = found.get(name, (np.inf, np.inf))
                found[name] = (
                    min(most, term.max_acceleration_mps2),
                    min(hardest, term.max_braking_mps2),
                )
    return found


def _from_now(
    recorded: np.ndarray, rows: np.ndarray, now: int, sampled: np.ndarray
) -> np.ndarray:
    return np.concatenate([recorded[rows, :now], sampled], axis=1)
