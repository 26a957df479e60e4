"""Guidance of a roll-out in its windows: what is left of its terms, by the window's clock."""

from collections.abc import Collection
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.guidance_kind import AgentNow
from pd_editor.analysis.guidance.kinds.course import LANE_REACH_M, GoalPoint, nearest_on
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.report import term_outcomes
from pd_editor.editor.commands.roll_out import with_length
from pd_editor.experiments.closed_loop.world import HORIZON, World
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.guidance_outcome import TermOutcome
from pd_editor.scene.guidance_terms import GuidanceTerm, Point, terms_without
from pd_editor.scene.roles.traffic_choice import trajectory_locked_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import TrafficSample

_HERE_M: Final = 2.0
_TO_GOAL_M: Final = 15.0
"""Way on which an agent leaves its path for a goal beside it."""


def guidance_now(
    world: World, window: Scenario, agent_ids: Collection[str]
) -> tuple[GuidanceTerm, ...]:
    """What is left of the terms of a roll-out for the agents that are generated now.

    A goal beyond the horizon becomes a path at a pace that gets there in time, unless
    something else leads its agent before.
    """
    scenario, there = world.scenario, set(window.agents.ids)
    gone = [name for name in scenario.agents.ids if name not in there]
    horizon_s = HORIZON * scenario.time_axis.step_s
    found: list[GuidanceTerm] = []
    far: list[GoalPoint] = []
    for term in terms_without(scenario.guidance, gone):
        ids = term.guided_ids
        if not term.is_in_force or (ids and not set(ids).intersection(agent_ids)):
            continue
        asked = term
        if isinstance(term, GoalPoint) and term.at_s is None:
            end = world.last_step - scenario.current_step
            asked = replace(term, at_s=end * scenario.time_axis.step_s)
        left = scenario.later_term(asked, world.step)
        if isinstance(left, GoalPoint) and (left.at_s or 0.0) > horizon_s:
            far.append(left)
        elif left is not None:
            found.append(left)
    leads = (GoalPoint, FollowPath, FollowLane)
    led = {one.agent_id for one in found if isinstance(one, leads)}
    for goal in sorted(far, key=lambda one: one.at_s or 0.0):
        way = None if goal.agent_id in led else _way_to(goal, window, horizon_s)
        led.add(goal.agent_id)
        found += [] if way is None else [way]
    return tuple(found)


def guidance_outcomes(
    before: Scenario, after: Scenario, driven: Collection[str]
) -> tuple[TermOutcome, ...]:
    """What a roll-out achieved of the guidance that it began with.

    Terms of agents that have left are judged up to then, those of all agents by the ones
    that stay. ``driven`` agents are not guided.
    """
    terms = [term for term in before.guidance if term.is_in_force]
    if not terms:
        return ()
    agents, now = after.agents, after.current_step
    kept = trajectory_locked_ids(before).union(driven)
    guided = agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS)
    rows = np.flatnonzero(guided & ~np.isin(agents.ids, list(kept)))
    there = agents.is_valid[rows, now:]
    count = np.where(there.all(axis=1), there.shape[1], there.argmin(axis=1))
    lasts = dict(zip((agents.ids[row] for row in rows), count.tolist(), strict=True))
    found: list[TermOutcome] = []
    for term in terms:
        own = [lasts[name] for name in term.guided_ids if name in lasts]
        num_steps = min(own, default=there.shape[1])
        some = rows[count >= num_steps]
        steps = slice(now, now + num_steps)
        sample = TrafficSample.of(agents.taken(some).cut_to(steps))
        part = with_length(after, agents.cut_to(slice(now + num_steps)))
        (one,) = term_outcomes(part, sample, (term,))
        if num_steps < there.shape[1]:
            told = f"; left the map at {num_steps * after.time_axis.step_s:.1f} s"
            one = replace(one, achieved=one.achieved + told)
        found.append(one)
    return tuple(found)


def _way_to(
    goal: GoalPoint, window: Scenario, horizon_s: float
) -> FollowPath | GoalPoint | None:
    """The planned path to a goal, at which the agent is to be in time; None without one.

    An agent that is there stays.
    """
    row = window.agents.row_of[goal.agent_id]
    agent = AgentNow(scenario=window, row=row, lasts_s=goal.at_s)
    along, beside = nearest_on(agent.paths_m, np.array(goal.point_m))
    best = int((beside + np.maximum(-along, 0.0)).argmin())
    if beside[best] > LANE_REACH_M or along[best] < -_HERE_M:
        return None
    if along[best] < _HERE_M:
        return replace(goal, at_s=horizon_s)
    path = agent.paths_m[best]
    before = path[1:][arc_length(path)[1:] < along[best] - _TO_GOAL_M]
    points = (*map(_point, (path[0], *before)), goal.point_m)
    return FollowPath(
        agent_id=goal.agent_id,
        points_m=points,
        times_s=(*(None for _ in points[1:]), goal.at_s),
        weight=goal.weight,
    )


def _point(point_m: Float[np.ndarray, "2"]) -> Point:
    return float(point_m[0]), float(point_m[1])
