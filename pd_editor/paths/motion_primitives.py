"""Frenet candidates: where each agent could be over the next seconds.

After Path Diffuser (Lee et al., section III-D): reference lanes, a grid of speeds and
of lateral offsets. Here speeds are relative to the agent's own, curves slow it down,
own speed and standstill are always among the candidates, and no two are alike.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.angles import heading_of, unit_vector
from pd_editor.paths.driving_paths import (
    DrivingPaths,
    free_paths,
    joined_paths,
    num_path_points,
    paths_along_routes,
)
from pd_editor.paths.route_choice import RouteChoice, choose_routes
from pd_editor.paths.speed_profiles import MAX_ACCELERATION_MPS2, drive
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario

MAX_SPEED_MPS: Final = 30.0
"""No candidate speeds up beyond this."""
SAME_M: Final = 0.3
"""Candidates that are so close half way and at the end count as one."""
MAX_LATERAL_OFFSET_M: Final = 1.25
"""Candidates of an agent on its lane end at most so far from the centre line."""
LATERAL_SHIFT_M: Final = 1.0
ARC_CURVATURES_1PM: Final = (0.03, -0.03, 0.1, -0.1)
_FAR_M: Final = 1e9
_MOVES_MPS: Final = 0.5
"""Slower velocities are too noisy to tell a direction."""


@dataclass(frozen=True, kw_only=True)
class SpeedPlan:
    """A target speed relative to the own one, and how briskly it is neared."""

    factor: float
    extra_mps: float
    acceleration_mps2: float = MAX_ACCELERATION_MPS2
    braking_mps2: float = 2.0


SPEED_PLANS: Final = (
    SpeedPlan(factor=1.0, extra_mps=0.0),
    SpeedPlan(factor=0.0, extra_mps=0.0, braking_mps2=4.0),
    SpeedPlan(factor=1.0, extra_mps=3.0, acceleration_mps2=1.2),
    SpeedPlan(factor=0.5, extra_mps=0.0),
    SpeedPlan(factor=1.0, extra_mps=6.0, acceleration_mps2=1.8),
    SpeedPlan(factor=0.75, extra_mps=0.0),
    SpeedPlan(factor=0.0, extra_mps=0.0, braking_mps2=1.5),
    SpeedPlan(factor=1.0, extra_mps=10.0),
)
"""The first keeps the speed, the second stops as soon as it can."""
_OWN, _STOP = 0, 1


class _Role(IntEnum):
    MAIN = 0
    BRANCH = 1
    SHIFT = 2
    CHANGE = 3
    STRAIGHT = 4
    ARC = 5


_ORDER: Final = np.array(
    [
        [0, 1, 3, 4, 5, 6, 9, 10],
        [2, 99, 5, 5, 8, 9, 11, 12],
        [6, 99, 14, 14, 99, 99, 99, 99],
        [7, 99, 10, 10, 13, 13, 99, 99],
        [0, 1, 4, 3, 99, 99, 99, 99],
        [2, 99, 99, 5, 99, 99, 99, 99],
    ]
)
"""When the plans of each role's paths get their turn; 99 is never."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateSet:
    """C candidates of each of A agents at H points, the first being the current state.

    Candidates are sorted, the most natural first; other fields are 0 where
    ``is_valid`` is false.
    """

    position_m: Float[np.ndarray, "A C H 2"]
    heading_rad: Float[np.ndarray, "A C H"]
    velocity_mps: Float[np.ndarray, "A C H 2"]
    is_valid: Bool[np.ndarray, "A C"]
    lane_ids: tuple[tuple[tuple[int, ...], ...], ...]
    """Lanes of the route of each valid candidate, per agent; none off the lanes."""
    target_speed_mps: Float[np.ndarray, "A C"]
    lateral_shift_m: Float[np.ndarray, "A C"]
    """Final minus initial offset from the route, to the left."""
    beyond_lanes_m: Float[np.ndarray, "A C"]
    """How far it drives straight on where the map's lanes have ended."""
    is_standstill: Bool[np.ndarray, "A C"]
    """Whether it stays standing, or stops as soon as it can."""
    is_lane_change: Bool[np.ndarray, "A C"]
    has_lane: Bool[np.ndarray, "A"]
    """False for agents that follow no lane: too far from any, or of such a kind."""


def candidates(
    scenario: Scenario, rows: np.ndarray, *, max_candidates: int = 32
) -> CandidateSet:
    """Candidates of the agents at ``rows``, each from its state at the current step.

    An agent's candidates depend on the map and on its own state only.
    """
    assert max_candidates >= 2, "own speed and standstill are always among them"
    start = _Start.of(scenario, np.asarray(rows, int))
    plans = _plan_paths(scenario, start)
    path, plan = _turns(plans, 2 * max_candidates)
    target = _targets(start.speed_mps[plans.agent[path]], plan)
    axis = scenario.time_axis
    reached = drive(
        plans.paths,
        path,
        speed_mps=start.speed_mps[plans.agent[path]],
        target_mps=target,
        acceleration_mps2=np.array([p.acceleration_mps2 for p in SPEED_PLANS])[plan],
        braking_mps2=np.array([p.braking_mps2 for p in SPEED_PLANS])[plan],
        num_steps=axis.num_future_steps,
        step_s=axis.step_s,
    )
    kept, slot = _distinct(plans, path, reached, len(start.kinds), max_candidates)
    return _packed(
        start,
        plans,
        path=path[kept],
        plan=plan[kept],
        slot=slot,
        reached_m=reached[kept],
        target_mps=target[kept],
        step_s=axis.step_s,
        max_candidates=max_candidates,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Start:
    """The asked agents at the current step."""

    kinds: tuple
    position_m: Float[np.ndarray, "A 2"]
    heading_rad: Float[np.ndarray, "A"]
    velocity_mps: Float[np.ndarray, "A 2"]
    speed_mps: Float[np.ndarray, "A"]

    @classmethod
    def of(cls, scenario: Scenario, rows: np.ndarray) -> "_Start":
        agents, step = scenario.agents, scenario.current_step
        velocity = agents.velocity_mps[rows, step]
        return cls(
            kinds=tuple(agents.kinds[row] for row in rows),
            position_m=agents.position_m[rows, step],
            heading_rad=agents.heading_rad[rows, step],
            velocity_mps=velocity,
            speed_mps=np.hypot(velocity[:, 0], velocity[:, 1]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _PlannedPaths:
    """P paths with what they are for."""

    paths: DrivingPaths
    agent: Int[np.ndarray, "P"]
    role: Int[np.ndarray, "P"]
    shift_m: Float[np.ndarray, "P"]
    route: Int[np.ndarray, "P"]
    """Index into the choice; -1 without a route."""
    choice: RouteChoice


def _plan_paths(scenario: Scenario, start: _Start) -> _PlannedPaths:
    axis = scenario.time_axis
    duration = axis.num_future_steps * axis.step_s
    gained = MAX_ACCELERATION_MPS2 * duration**2 / 2
    longest = MAX_SPEED_MPS * duration
    needed = np.minimum(start.speed_mps * duration + gained, longest)
    choice = choose_routes(
        scenario.road_map, start.position_m, start.heading_rad, start.kinds, needed
    )
    route, role, offset = _lateral_grid(choice)
    num_points = num_path_points(longest)
    along = paths_along_routes(
        choice,
        route,
        start.position_m,
        start.heading_rad,
        start.speed_mps,
        offset,
        num_points,
    )
    agent, free_role, curvature = _free_grid(start, choice)
    moving = start.speed_mps > _MOVES_MPS
    direction = np.where(moving, heading_of(start.velocity_mps), start.heading_rad)
    free = free_paths(
        start.position_m[agent],
        start.heading_rad[agent],
        direction[agent],
        curvature,
        num_points,
    )
    return _PlannedPaths(
        paths=joined_paths(along, free),
        agent=np.concatenate([choice.agent[route], agent]),
        role=np.concatenate([role, free_role]),
        shift_m=np.concatenate([offset - choice.offset_m[route], np.zeros(len(agent))]),
        route=np.concatenate([route, np.full(len(agent), -1)]),
        choice=choice,
    )


def _lateral_grid(
    choice: RouteChoice,
) -> tuple[Int[np.ndarray, "P"], Int[np.ndarray, "P"], Float[np.ndarray, "P"]]:
    """Route, role and final offset of each path along a route."""
    is_main = np.diff(choice.agent, prepend=-1) != 0
    most = MAX_LATERAL_OFFSET_M
    kept = np.clip(choice.offset_m, -most, most)
    kept = np.where(choice.is_lane_change, 0.0, kept)
    every = np.arange(len(choice.agent))
    main = every[is_main]
    role = np.where(choice.is_lane_change, _Role.CHANGE, _Role.BRANCH)
    role = np.where(is_main, _Role.MAIN, role)
    shifted = [
        np.clip(kept[main] + shift, -most, most)
        for shift in (-LATERAL_SHIFT_M, LATERAL_SHIFT_M)
    ]
    return (
        np.concatenate([every, main, main, main]),
        np.concatenate([role, np.full(3 * len(main), _Role.SHIFT)]),
        np.concatenate([kept, *shifted, np.zeros(len(main))]),
    )


def _free_grid(
    start: _Start, choice: RouteChoice
) -> tuple[Int[np.ndarray, "P"], Int[np.ndarray, "P"], Float[np.ndarray, "P"]]:
    """Agent, role and curvature of each path without a route.

    Agents that follow no lane get a straight one, drivers among them arcs as well,
    and so do drivers that roll backwards.
    """
    count = len(start.kinds)
    forward = (start.velocity_mps * unit_vector(start.heading_rad)).sum(-1)
    drives = np.array([kind in LANE_FOLLOWER_KINDS for kind in start.kinds], bool)
    without = ~np.isin(np.arange(count), choice.agent)
    backwards = drives & (forward < -_MOVES_MPS)
    straight = np.flatnonzero(without | backwards)
    turning = np.flatnonzero(without & drives & ~backwards)
    num_arcs = len(ARC_CURVATURES_1PM)
    return (
        np.concatenate([straight, np.repeat(turning, num_arcs)]),
        np.repeat(
            [_Role.STRAIGHT, _Role.ARC], [len(straight), num_arcs * len(turning)]
        ),
        np.concatenate(
            [np.zeros(len(straight)), np.tile(ARC_CURVATURES_1PM, len(turning))]
        ),
    )


def _turns(
    plans: _PlannedPaths, most: int
) -> tuple[Int[np.ndarray, "K"], Int[np.ndarray, "K"]]:
    """Path and speed plan of each candidate to try, by agent and then by turn."""
    order = _ORDER[plans.role]
    path, plan = np.nonzero(order < 99)
    index = np.lexsort((path, order[path, plan], plans.agent[path]))
    path, plan = path[index], plan[index]
    agent = plans.agent[path]
    rank = np.arange(len(agent)) - np.searchsorted(agent, agent)
    return path[rank < most], plan[rank < most]


def _targets(
    speed_mps: Float[np.ndarray, "K"], plan: Int[np.ndarray, "K"]
) -> Float[np.ndarray, "K"]:
    factor = np.array([plan.factor for plan in SPEED_PLANS])[plan]
    extra = np.array([plan.extra_mps for plan in SPEED_PLANS])[plan]
    fastest = np.maximum(speed_mps, MAX_SPEED_MPS)
    return np.minimum(factor * speed_mps + extra, fastest)


def _distinct(
    plans: _PlannedPaths,
    path: Int[np.ndarray, "K"],
    reached_m: Float[np.ndarray, "K H"],
    num_agents: int,
    most: int,
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Candidates that differ from all kept before them, and their places."""
    agent = plans.agent[path]
    rank = np.arange(len(agent)) - np.searchsorted(agent, agent)
    half = reached_m.shape[1] // 2
    marks = plans.paths.position_at(path, reached_m[:, [half, -1]])
    tries = int(rank.max(initial=-1)) + 1
    table = np.full((num_agents, tries, 2, 2), _FAR_M)
    table[agent, rank] = marks
    kept = np.zeros((num_agents, tries), bool)
    for index in range(tries):
        step = table[:, :index] - table[:, index, None]
        gap = (step**2).sum(-1).max(-1)
        same = (gap < SAME_M**2) & kept[:, :index]
        exists = table[:, index, 0, 0] < _FAR_M
        kept[:, index] = exists & ~same.any(1) & (kept.sum(1) < most)
    chosen = kept[agent, rank]
    slot = (np.cumsum(kept, axis=1) - 1)[agent, rank]
    return np.flatnonzero(chosen), slot[chosen]


def _packed(
    start: _Start,
    plans: _PlannedPaths,
    *,
    path: Int[np.ndarray, "N"],
    plan: Int[np.ndarray, "N"],
    slot: Int[np.ndarray, "N"],
    reached_m: Float[np.ndarray, "N H"],
    target_mps: Float[np.ndarray, "N"],
    step_s: float,
    max_candidates: int,
) -> CandidateSet:
    agent, route = plans.agent[path], plans.route[path]
    shape = (len(start.kinds), max_candidates)

    def placed(values: np.ndarray) -> np.ndarray:
        table = np.zeros((*shape, *values.shape[1:]), values.dtype)
        table[agent, slot] = values
        return table

    position = plans.paths.position_at(path, reached_m)
    position[:, 0] = start.position_m[agent]
    velocity = np.empty_like(position)
    velocity[:, 0] = start.velocity_mps[agent]
    velocity[:, 1:-1] = (position[:, 2:] - position[:, :-2]) / (2 * step_s)
    velocity[:, -1] = (position[:, -1] - position[:, -2]) / step_s
    heading = plans.paths.heading_at(path, reached_m)
    heading[:, 0] = start.heading_rad[agent]
    choice = plans.choice
    ends = np.array(
        [one.extends_m if one.is_dead_end else np.inf for one in choice.routes]
    )
    beyond = np.zeros(len(path))
    on_route = route >= 0
    beyond[on_route] = np.maximum(
        choice.along_m[route[on_route]]
        + reached_m[on_route, -1]
        - ends[route[on_route]],
        0,
    )
    lanes: list[list[tuple[int, ...]]] = [[] for _ in start.kinds]
    for index, one in zip(agent.tolist(), route.tolist(), strict=True):
        lanes[index].append(choice.routes[one].lane_ids if one >= 0 else ())
    return CandidateSet(
        position_m=placed(position),
        heading_rad=placed(heading),
        velocity_mps=placed(velocity),
        is_valid=placed(np.ones(len(path), bool)),
        lane_ids=tuple(map(tuple, lanes)),
        target_speed_mps=placed(target_mps),
        lateral_shift_m=placed(plans.shift_m[path]),
        beyond_lanes_m=placed(beyond),
        is_standstill=placed((plan == _STOP) | (target_mps == 0.0)),
        is_lane_change=placed(plans.role[path] == _Role.CHANGE),
        has_lane=np.isin(np.arange(shape[0]), choice.agent),
    )
