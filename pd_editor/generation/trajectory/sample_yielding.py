"""Agents of a sample beside each other: tries that do not collide, and who yields."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.speed import ComfortLimits, StopAtLine
from pd_editor.analysis.metrics.box_overlaps import boxes_collide
from pd_editor.analysis.repair.retimed_trajectories import yield_to_others
from pd_editor.generation.trajectory.guidance.threat_run import threats_in_force
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentCategory, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.geometry.angles import heading_of
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import closed_lines

_STRIDE: Final = 2
"""Stride of the steps at which boxes are compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryChoices:
    """K trajectories of A agents at F + 1 steps, the first one the current step.

    Agents with a fixed trajectory have K equal ones.
    """

    position_m: Float[np.ndarray, "K A S 2"]
    heading_rad: Float[np.ndarray, "K A S"]
    exists: Bool[np.ndarray, "A S"]
    size_m: Float[np.ndarray, "A 2"]


def select_jointly(
    choices: TrajectoryChoices, is_sampled: Bool[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Select one trajectory per agent such that few boxes collide; returns indices.

    The selection starts from the first trajectory of every agent; then agents in conflict
    switch, one after another, to the trajectory with the fewest conflicts. Agents without
    conflicts keep their first one, which preserves the diversity of samples.
    """
    num_choices = len(choices.position_m)
    pairs, conflicts = _conflicts(choices, is_sampled)
    choice = np.zeros(len(is_sampled), int)
    for _ in range(4):
        now = conflicts[np.arange(len(pairs)), choice[pairs[:, 0]], choice[pairs[:, 1]]]
        changed = False
        for row in np.unique(pairs[now > 0]):
            if not is_sampled[row]:
                continue
            cost = np.zeros(num_choices)
            first, second = pairs[:, 0] == row, pairs[:, 1] == row
            cost += conflicts[first, :, choice[pairs[first, 1]]].sum(axis=0)
            cost += conflicts[second, choice[pairs[second, 0]]].sum(axis=0)
            best = int(np.argmin(cost))
            if cost[best] < cost[choice[row]]:
                choice[row], changed = best, True
        if not changed:
            break
    return choice


def _conflicts(
    choices: TrajectoryChoices, is_sampled: Bool[np.ndarray, "A"]
) -> tuple[Int[np.ndarray, "P 2"], Int[np.ndarray, "P K K"]]:
    """Pairs of agents that can meet, and the number of colliding steps by trajectories.

    Pairs that overlap at the current step are left out.
    """
    position = choices.position_m[:, :, ::_STRIDE]
    exists = choices.exists[:, ::_STRIDE]
    radius = 0.5 * np.hypot(choices.size_m[:, 0], choices.size_m[:, 1])
    one, two = np.triu_indices(len(is_sampled), 1)
    low = np.where(exists[..., None], position, np.inf).min(axis=(0, 2))
    high = np.where(exists[..., None], position, -np.inf).max(axis=(0, 2))
    reach = (radius[one] + radius[two])[:, None]
    meets = (low[one] - high[two] < reach) & (low[two] - high[one] < reach)
    meets = meets.all(axis=1) & (is_sampled[one] | is_sampled[two])
    one, two = one[meets], two[meets]
    both = exists[one] & exists[two]
    boxes = Boxes(
        position_m=position,
        heading_rad=choices.heading_rad[:, :, ::_STRIDE],
        size_m=choices.size_m[:, None],
    )
    hits = boxes_collide(boxes[:, None, one], boxes[None, :, two], both)
    first, second, pair, step = np.nonzero(hits)
    count = np.zeros((len(one), len(position), len(position)), int)
    np.add.at(count, (pair, first, second), 1)
    begins = np.zeros(len(one), bool)
    begins[pair[step == 0]] = True
    return np.stack([one, two], axis=-1)[~begins], count[~begins]


_BARRIER_M: Final = 0.2
_BARRIER_SHARE: Final = 0.5
"""Depth of a stop line as an obstacle, and its share of the lane's width: vehicles that
pass in the next lane do not touch it."""


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
    is enough. Stop lines of red signals are obstacles, unless these agents cross them.
    Also returns the ids of the agents that yield.
    """
    now, agents = scenario.current_step, scenario.agents
    driven = sample.applied_to(agents, rows, now)
    doubles = LateAgents.of(scenario).continuing(rows).row
    if len(doubles):
        driven = driven.with_rows(doubles, is_valid=np.array(False))
    threats = {name for one in threats_in_force(terms) for name in one.named_ids}
    last_ids = {
        one.agent_id
        for one in terms
        if isinstance(one, GoalPoint | StopAtLine) and one.is_on
    }
    asked = np.isin(sample.ids, [*threats, *last_ids])
    barriers = _barriers(scenario, sample.position_m[asked])
    waiting, ids = yield_to_others(
        scenario.with_agents(driven.joined(barriers) if len(barriers) else driven),
        set(sample.ids) - threats,
        last_ids=last_ids,
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


def _barriers(scenario: Scenario, asked_m: Float[np.ndarray, "C H 2"]) -> AgentTracks:
    """Objects on stop lines while all have to stop from now on, but for the ways given."""
    if not scenario.signals:
        return scenario.agents.taken(np.zeros(0, int))
    lines, is_closed = closed_lines(scenario.signals, scenario.road_map)
    ends = np.asarray(shapely.linestrings(lines[:, [0, 2]]))
    crossed = shapely.intersects(ends[:, None], shapely.linestrings(asked_m))
    counts = is_closed[:, scenario.current_step] & ~crossed.any(axis=1)
    lines, is_closed = lines[counts], is_closed[counts]
    count, num_steps = len(lines), scenario.time_axis.num_steps
    across = lines[:, 2] - lines[:, 0]
    width = np.linalg.norm(across, axis=-1) * _BARRIER_SHARE
    heading = heading_of(across) + np.pi / 2
    taken = scenario.retired_ids.union(scenario.agents.ids)
    numbers = (f"stop line {number}" for number in itertools.count())
    free = (name for name in numbers if name not in taken)
    return AgentTracks(
        ids=tuple(itertools.islice(free, count)),
        kinds=(AgentKind.STATIC,) * count,
        categories=(AgentCategory.UNSCORED,) * count,
        size_m=np.column_stack([np.full(count, _BARRIER_M), width]),
        has_known_size=np.ones(count, bool),
        position_m=np.repeat(lines[:, 1, None], num_steps, axis=1),
        heading_rad=np.repeat(heading[:, None], num_steps, axis=1),
        velocity_mps=np.zeros((count, num_steps, 2)),
        is_valid=is_closed,
        observed=is_closed,
    )


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
