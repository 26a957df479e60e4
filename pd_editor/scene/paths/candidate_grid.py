"""Grid of candidates: paths, and target speeds on each path."""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import heading_of, unit_vector
from pd_editor.scene.paths.car_following import BoxesAhead, MovingBoxes, boxes_ahead
from pd_editor.scene.paths.driving_paths import (
    DrivingPaths,
    free_paths,
    joined_paths,
    num_path_points,
    paths_along_routes,
)
from pd_editor.scene.paths.lanes.route_choice import RouteChoice, choose_routes
from pd_editor.scene.paths.retiming import MAX_BRAKING_MPS2
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2, MOVING_MPS

MAX_SPEED_MPS: Final = 30.0
"""Highest target speed of candidates that accelerate."""
MAX_LATERAL_OFFSET_M: Final = 1.25
"""Largest final offset from the centre line of an agent on its lane."""
LATERAL_SHIFT_M: Final = 1.0
ARC_CURVATURES_1PM: Final = (0.03, -0.03, 0.1, -0.1)
_LEAST_SHIFT_M: Final = 0.3


@dataclass(frozen=True, kw_only=True)
class SpeedPlan:
    """Target speed relative to the current speed, with acceleration and braking."""

    factor: float
    extra_mps: float = 0.0
    acceleration_mps2: float = FIRM_ACCELERATION_MPS2
    braking_mps2: float = 2.0


SPEED_PLANS: Final = (
    SpeedPlan(factor=1.0),
    SpeedPlan(factor=0.0, braking_mps2=MAX_BRAKING_MPS2),
    SpeedPlan(factor=0.0, braking_mps2=1.5),
    SpeedPlan(factor=1.0, extra_mps=4.5, acceleration_mps2=1.2),
    SpeedPlan(factor=0.85, braking_mps2=0.7),
    SpeedPlan(factor=1.0, extra_mps=2.0, acceleration_mps2=0.9),
    SpeedPlan(factor=1.0, extra_mps=8.0, acceleration_mps2=2.0),
    SpeedPlan(factor=0.25, braking_mps2=1.0),
    SpeedPlan(factor=1.0, extra_mps=5.0, acceleration_mps2=1.6),
    SpeedPlan(factor=1.0, acceleration_mps2=1.8),
)
"""Plan 0 keeps the speed, plan 1 stops as soon as possible, the last one follows the
agent ahead.

The others were chosen greedily on training scenarios, for the smallest mean distance
from the best candidate to the logged trajectory.
"""

FOLLOWING: Final = len(SPEED_PLANS) - 1
"""Index of the plan that follows the agent ahead on a path."""


class Role(IntEnum):
    """Role of a path among the candidates of an agent."""

    MAIN = 0
    """The most natural route, keeping the lateral offset."""
    BRANCH = 1
    """Another route."""
    SHIFT = 2
    """The most natural route with another offset."""
    CHANGE = 3
    """A lane change."""
    STRAIGHT = 4
    """Straight on, without a lane."""
    OFF_LANE = 5
    """Straight on, of a driver off the lanes."""
    ARC = 6
    """Arc of a driver off the lanes."""


_NEVER: Final = 99
_TURN: Final = np.array(
    [
        [0, 1, 3, 4, 5, 6, 7, 8, 9, 1],
        [2, 99, 5, 6, 7, 8, 9, 10, 12, 3],
        [6, 99, 99, 14, 99, 99, 99, 99, 99, 99],
        [7, 99, 13, 10, 99, 12, 99, 99, 99, 99],
        [0, 1, 99, 99, 99, 99, 99, 99, 99, 99],
        [0, 1, 3, 4, 99, 5, 99, 99, 99, 2],
        [2, 99, 6, 7, 99, 5, 99, 99, 99, 99],
    ]
)
"""Priority [role, plan] of each speed plan on paths of each role; 99 means never."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """Current states of the agents that candidates are computed for."""

    kinds: tuple[AgentKind, ...]
    position_m: Float[np.ndarray, "A 2"]
    heading_rad: Float[np.ndarray, "A"]
    velocity_mps: Float[np.ndarray, "A 2"]
    speed_mps: Float[np.ndarray, "A"]
    exists: Bool[np.ndarray, "A"]

    @classmethod
    def of(cls, scenario: Scenario, rows: np.ndarray) -> "Start":
        """Current states of the agents at ``rows``."""
        return cls.at(scenario.agents, scenario.current_step, rows)

    @classmethod
    def at(cls, agents: AgentTracks, step: int, rows: np.ndarray) -> "Start":
        """States of the agents at ``rows`` at a step."""
        velocity = agents.velocity_mps[rows, step]
        return cls(
            kinds=tuple(agents.kinds[row] for row in rows),
            position_m=agents.position_m[rows, step],
            heading_rad=agents.heading_rad[rows, step],
            velocity_mps=velocity,
            speed_mps=np.hypot(velocity[:, 0], velocity[:, 1]),
            exists=agents.is_valid[rows, step],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedPaths:
    """P paths with their roles."""

    paths: DrivingPaths
    agent: Int[np.ndarray, "P"]
    role: Int[np.ndarray, "P"]
    shift_m: Float[np.ndarray, "P"]
    route: Int[np.ndarray, "P"]
    """Index into the choice; -1 without a route."""
    choice: RouteChoice

    def beyond_lanes_m(
        self, path: Int[np.ndarray, "K"], reached_m: Float[np.ndarray, "K H"]
    ) -> Float[np.ndarray, "K H"]:
        """Length that is driven straight on beyond the end of the map's lanes."""
        choice, route = self.choice, self.route[path]
        ends = np.array(
            [one.extends_m if one.is_dead_end else np.inf for one in choice.routes]
        )
        beyond = np.zeros_like(reached_m)
        on_route = route >= 0
        along = choice.along_m[route[on_route], None] + reached_m[on_route]
        beyond[on_route] = np.maximum(along - ends[route[on_route], None], 0.0)
        return beyond


@lru_cache(maxsize=64)
def current_paths(
    road_map: RoadMap,
    agents: AgentTracks,
    step: int,
    rows: tuple[int, ...],
    duration_s: float,
) -> PlannedPaths:
    """Paths of agents from a step on; guidance asks for them again while terms change."""
    return plan_paths(road_map, Start.at(agents, step, np.array(rows)), duration_s)


def plan_paths(
    road_map: RoadMap,
    start: Start,
    duration_s: float,
    *,
    drivers_go_straight: bool = False,
) -> PlannedPaths:
    """Paths along routes; agents without a route, or all drivers, get free paths."""
    gained = FIRM_ACCELERATION_MPS2 * duration_s**2 / 2
    longest = MAX_SPEED_MPS * duration_s
    needed = np.minimum(start.speed_mps * duration_s + gained, longest)
    choice = choose_routes(
        road_map, start.position_m, start.heading_rad, start.kinds, needed
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
    agent, free_role, curvature = _free_grid(start, choice, drivers_go_straight)
    moving = start.speed_mps > MOVING_MPS
    direction = np.where(moving, heading_of(start.velocity_mps), start.heading_rad)
    free = free_paths(
        start.position_m[agent],
        start.heading_rad[agent],
        direction[agent],
        curvature,
        num_points,
    )
    return PlannedPaths(
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
    role = np.where(choice.is_lane_change, Role.CHANGE, Role.BRANCH)
    role = np.where(is_main, Role.MAIN, role)
    final = np.stack(
        [
            np.clip(kept[main] - LATERAL_SHIFT_M, -most, most),
            np.clip(kept[main] + LATERAL_SHIFT_M, -most, most),
            np.zeros(len(main)),
        ],
        axis=1,
    )
    near, side = np.nonzero(np.abs(final - kept[main, None]) > _LEAST_SHIFT_M)
    return (
        np.concatenate([every, main[near]]),
        np.concatenate([role, np.full(len(near), Role.SHIFT)]),
        np.concatenate([kept, final[near, side]]),
    )


def _free_grid(
    start: Start, choice: RouteChoice, drivers_go_straight: bool
) -> tuple[Int[np.ndarray, "P"], Int[np.ndarray, "P"], Float[np.ndarray, "P"]]:
    """Agent, role and curvature of each path without a route.

    Agents that follow no lane get a straight path. Drivers among them, and drivers
    that roll backwards, get arcs as well.
    """
    count = len(start.kinds)
    forward = (start.velocity_mps * unit_vector(start.heading_rad)).sum(-1)
    drives = np.array([kind in LANE_FOLLOWER_KINDS for kind in start.kinds], bool)
    without = ~np.isin(np.arange(count), choice.agent)
    backwards = drives & (forward < -MOVING_MPS)
    straight = np.flatnonzero(without | backwards | (drives & drivers_go_straight))
    turning = np.flatnonzero(without & drives & ~backwards)
    num_arcs = len(ARC_CURVATURES_1PM)
    role = np.where((drives & ~backwards)[straight], Role.OFF_LANE, Role.STRAIGHT)
    return (
        np.concatenate([straight, np.repeat(turning, num_arcs)]),
        np.concatenate([role, np.full(num_arcs * len(turning), Role.ARC)]),
        np.concatenate(
            [np.zeros(len(straight)), np.tile(ARC_CURVATURES_1PM, len(turning))]
        ),
    )


def leaders(
    scenario: Scenario, rows: Int[np.ndarray, "A"], plans: PlannedPaths
) -> BoxesAhead:
    """Leader on each path with a following plan; driver indices are path indices."""
    agents, step = scenario.agents, scenario.current_step
    position, velocity = agents.position_m[:, step], agents.velocity_mps[:, step]
    heading = agents.heading_rad[:, step]
    known = np.isfinite(np.column_stack([position, velocity, heading])).all(axis=1)
    boxes = MovingBoxes(
        position_m=position,
        heading_rad=heading,
        velocity_mps=velocity,
        size_m=agents.size_m,
        exists=agents.is_valid[:, step] & known,
    )
    path = np.flatnonzero(_TURN[plans.role, FOLLOWING] < _NEVER)
    place = np.zeros(len(path))
    drivers = rows[plans.agent[path]]
    found = boxes_ahead(plans.paths, path, place, drivers, boxes).nearest()
    return replace(found, driver=path[found.driver])


def turns(
    plans: PlannedPaths,
    exists: Bool[np.ndarray, "A"],
    most: int,
    has_leader: Bool[np.ndarray, "P"],
) -> tuple[Int[np.ndarray, "K"], Int[np.ndarray, "K"]]:
    """Path and speed plan of each candidate, sorted by agent, then by priority."""
    order = _TURN[plans.role]
    wanted = (order < _NEVER) & exists[plans.agent, None]
    wanted[:, FOLLOWING] &= has_leader
    path, plan = np.nonzero(wanted)
    index = np.lexsort((path, order[path, plan], plans.agent[path]))
    path, plan = path[index], plan[index]
    agent = plans.agent[path]
    rank = np.arange(len(agent)) - np.searchsorted(agent, agent)
    return path[rank < most], plan[rank < most]


def targets(
    speed_mps: Float[np.ndarray, "K"], plan: Int[np.ndarray, "K"]
) -> Float[np.ndarray, "K"]:
    """Target speeds of plans, given current speeds."""
    factor = np.array([plan.factor for plan in SPEED_PLANS])[plan]
    extra = np.array([plan.extra_mps for plan in SPEED_PLANS])[plan]
    fastest = np.maximum(speed_mps, MAX_SPEED_MPS)
    return np.minimum(factor * speed_mps + extra, fastest)
