"""Intentions of drivers: a path and a desired speed, sampled at random."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.paths.driving_paths import (
    DrivingPaths,
    free_paths,
    joined_paths,
    num_path_points,
    paths_along_routes,
)
from pd_editor.scene.paths.lanes.route_choice import RouteChoice, choose_routes
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, PARKED_OFFSET_M, PARKED_TURN_RAD

FREE_SPEED_MPS: Final = {AgentKind.CYCLIST: 5.0}
DEFAULT_FREE_SPEED_MPS: Final = 10.0
"""Desired speed of drivers that start; Argoverse 2 maps have no speed limits."""
BRANCH_WEIGHT: Final = 0.2
CHANGE_WEIGHT: Final = 0.03
"""Weights of other routes and of lane changes against the most natural route."""
_CHANGE_LEAST_MPS: Final = 4.0
_MAX_OFFSET_M: Final = 1.0
_MAX_SPEED_MPS: Final = 35.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """D drivers at the current step."""

    row: Int[np.ndarray, "D"]
    kinds: tuple[AgentKind, ...]
    position_m: Float[np.ndarray, "D 2"]
    heading_rad: Float[np.ndarray, "D"]
    velocity_mps: Float[np.ndarray, "D 2"]
    speed_mps: Float[np.ndarray, "D"]
    """Speed forwards, not below 0."""
    choice: RouteChoice
    num_points: int
    """Number of points of their paths."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Intentions:
    """Sampled intentions of D drivers."""

    paths: DrivingPaths
    desired_speed_mps: Float[np.ndarray, "D"]
    delay_s: Float[np.ndarray, "D"]
    """Time before which a standing driver does not start."""
    is_parked: Bool[np.ndarray, "D"]


def drivers_at(scenario: Scenario, rows: Int[np.ndarray, "D"]) -> Drivers:
    """Drivers at the current step with the routes that they could take."""
    agents, axis = scenario.agents, scenario.time_axis
    velocity = agents.velocity_mps[rows, axis.current_step]
    heading = agents.heading_rad[rows, axis.current_step]
    position = agents.position_m[rows, axis.current_step]
    kinds = tuple(agents.kinds[row] for row in rows)
    forward = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    speed = np.maximum(forward, 0.0)
    duration = axis.future_s
    needed = np.minimum(speed, _MAX_SPEED_MPS) * duration + duration**2
    return Drivers(
        row=rows,
        kinds=kinds,
        position_m=position,
        heading_rad=heading,
        velocity_mps=velocity,
        speed_mps=speed,
        choice=choose_routes(scenario.road_map, position, heading, kinds, needed),
        num_points=num_path_points(float(needed.max(initial=0.0)) + 60.0),
    )


def sample_intentions(
    drivers: Drivers, num_agents: int, random: np.random.Generator
) -> Intentions:
    """Sample routes and desired speeds.

    Random numbers are generated for all agents of the scene, so that a driver's
    intention does not depend on which other agents are generated.
    """
    picks, starts, delays, hurries = random.random((4, num_agents))[:, drivers.row]
    spreads = random.standard_normal(num_agents)[drivers.row]
    choice, count = drivers.choice, len(drivers.kinds)
    route = _sampled_routes(drivers, picks)
    on_lane = route >= 0
    offset, turn = np.zeros(count), np.zeros(count)
    offset[on_lane] = choice.offset_m[route[on_lane]]
    turn[on_lane] = choice.turn_rad[route[on_lane]]
    stands = drivers.speed_mps < MOVING_MPS
    is_parked = stands & (
        ~on_lane | (np.abs(offset) > PARKED_OFFSET_M) | (np.abs(turn) > PARKED_TURN_RAD)
    )
    free = np.array(
        [FREE_SPEED_MPS.get(k, DEFAULT_FREE_SPEED_MPS) for k in drivers.kinds]
    )
    # Probability that a stationary driver on a lane starts within the horizon.
    wants_to_start = stands & ~is_parked & (starts < 0.4)
    # Relative standard deviation of desired speeds around the current speed.
    desired = drivers.speed_mps * np.exp(0.08 * spreads)
    # Slow drivers make up at most this share of their difference to the free speed.
    desired += 0.6 * hurries * np.maximum(free - drivers.speed_mps, 0.0)
    desired = np.where(stands, np.where(wants_to_start, free, 0.0), desired)
    # Stationary drivers that start do so within this time.
    return Intentions(
        paths=_paths(drivers, route, offset),
        desired_speed_mps=desired,
        delay_s=np.where(wants_to_start, delays * 3.0, 0.0),
        is_parked=is_parked,
    )


def _sampled_routes(
    drivers: Drivers, picks: Float[np.ndarray, "D"]
) -> Int[np.ndarray, "D"]:
    """Route of each driver, -1 without a lane."""
    choice = drivers.choice
    is_main = np.diff(choice.agent, prepend=-1) != 0
    weight = np.where(is_main, 1.0, BRANCH_WEIGHT)
    slow = drivers.speed_mps[choice.agent] < _CHANGE_LEAST_MPS
    weight = np.where(choice.is_lane_change, np.where(slow, 0.0, CHANGE_WEIGHT), weight)
    route = np.full(len(drivers.kinds), -1)
    first = np.searchsorted(choice.agent, np.arange(len(route) + 1))
    for driver, (start, end) in enumerate(pairwise(first)):
        if start < end:
            share = np.cumsum(weight[start:end])
            route[driver] = start + np.searchsorted(
                share, picks[driver] * share[-1], side="right"
            )
    return route


def _paths(
    drivers: Drivers, route: Int[np.ndarray, "D"], offset_m: Float[np.ndarray, "D"]
) -> DrivingPaths:
    """Path of each driver: along its route, straight on without one."""
    on_lane = np.flatnonzero(route >= 0)
    off_lane = np.flatnonzero(route < 0)
    change = drivers.choice.is_lane_change[route[on_lane]]
    final = np.clip(offset_m[on_lane], -_MAX_OFFSET_M, _MAX_OFFSET_M)
    along = paths_along_routes(
        drivers.choice,
        route[on_lane],
        drivers.position_m,
        drivers.heading_rad,
        drivers.speed_mps,
        np.where(change, 0.0, final),
        drivers.num_points,
    )
    straight = free_paths(
        drivers.position_m[off_lane],
        drivers.heading_rad[off_lane],
        drivers.heading_rad[off_lane],
        np.zeros(len(off_lane)),
        drivers.num_points,
    )
    order = np.argsort(np.concatenate([on_lane, off_lane]))
    return joined_paths(along, straight).taken(order)
