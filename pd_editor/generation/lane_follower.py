"""Rule-based baseline generator: lane following, car following and yielding."""

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.base.errors import GenerationError
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS, AgentKind
from pd_editor.scene.agent_states import MOTION
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    TrafficSample,
)
from pd_editor.scene.geometry.oriented_box import BoxStates
from pd_editor.scene.paths.car_following import (
    ACCELERATION_MPS2,
    HARDEST_BRAKING_MPS2,
    MovingBoxes,
    following_acceleration,
    leaders_acceleration,
)
from pd_editor.scene.paths.driving_paths import (
    SPACING_M,
    DrivingPaths,
    free_paths,
    joined_paths,
    num_path_points,
    paths_along_routes,
    velocity_of,
)
from pd_editor.scene.paths.lanes.route_choice import RouteChoice, choose_routes
from pd_editor.scene.paths.retiming import MAX_BRAKING_MPS2, RESPONSE_S
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, PARKED_OFFSET_M, PARKED_TURN_RAD
from pd_editor.scene.time_axis import TimeAxis

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


SEARCHED_M: Final = 70.0
"""Length of path ahead of the current state that is searched for crossings."""
NUM_SEARCHED: Final = int(SEARCHED_M / SPACING_M)
CLEARANCE_M: Final = 0.4
TIME_MARGIN_S: Final = 2.0
"""A driver does not yield to agents that leave the zone this long before it enters."""
_MERGING_RAD: Final = np.radians(30)
_LEAST_MPS: Final = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """Paths ahead of A agents: points every ``SPACING_M``, NaN beyond the end."""

    x_m: Float[np.ndarray, "A W"]
    y_m: Float[np.ndarray, "A W"]
    heading_rad: Float[np.ndarray, "A W"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """C conflict zones between a driver and another agent."""

    driver: Int[np.ndarray, "C"]
    other: Int[np.ndarray, "C"]
    entry_m: Float[np.ndarray, "C"]
    """Arc length at which the driver's path enters the zone."""
    other_entry_m: Float[np.ndarray, "C"]
    other_exit_m: Float[np.ndarray, "C"]
    is_merge: Bool[np.ndarray, "C"]
    """Whether both paths run the same way in the zone, so that one agent follows."""


def find_crossings(
    tracks: Tracks, rows: Int[np.ndarray, "D"], width_m: Float[np.ndarray, "A"]
) -> Crossings:
    """Find zones ahead where a driver's path comes close to another agent's path.

    Zones that one of both occupies already are left to car following.
    """
    found: list[tuple[int, int, int, int, int, bool]] = []
    for driver, row in enumerate(rows.tolist()):
        gap_x = tracks.x_m[row, :, None] - tracks.x_m[:, None, :]
        gap_y = tracks.y_m[row, :, None] - tracks.y_m[:, None, :]
        reach = (width_m[row] + width_m) / 2 + CLEARANCE_M
        squared = gap_x**2 + gap_y**2
        close = squared < (reach**2)[:, None, None]
        close[row] = False
        mine, theirs = np.any(close, axis=2), np.any(close, axis=1)
        for other in np.flatnonzero(mine.any(1)).tolist():
            points, others = np.flatnonzero(mine[other]), np.flatnonzero(theirs[other])
            if points[0] == 0 or others[0] == 0:
                continue
            turn = (
                tracks.heading_rad[row, points[-1]]
                - tracks.heading_rad[other, others[-1]]
            )
            merges = bool(np.cos(turn) > np.cos(_MERGING_RAD))
            found.append((driver, other, points[0], others[0], others[-1], merges))
    columns = np.array(found, float).reshape(-1, 6).T
    return Crossings(
        driver=columns[0].astype(int),
        other=columns[1].astype(int),
        entry_m=columns[2] * SPACING_M,
        other_entry_m=columns[3] * SPACING_M,
        other_exit_m=columns[4] * SPACING_M,
        is_merge=columns[5].astype(bool),
    )


def yielding_acceleration(
    crossings: Crossings,
    rows: Int[np.ndarray, "D"],
    place_m: Float[np.ndarray, "A"],
    speed_mps: Float[np.ndarray, "A"],
    length_m: Float[np.ndarray, "A"],
) -> Float[np.ndarray, "D"]:
    """Largest acceleration with which each driver yields at its conflict zones.

    ``place_m`` is the distance that each agent has travelled along its path.
    """
    row, other = rows[crossings.driver], crossings.other
    mine, theirs = speed_mps[row], speed_mps[other]
    to_go = crossings.entry_m - place_m[row] - length_m[row] / 2
    other_to_go = crossings.other_entry_m - place_m[other] - length_m[other] / 2
    other_to_leave = crossings.other_exit_m - place_m[other] + length_m[other] / 2
    arrival = to_go / np.maximum(mine, _LEAST_MPS)
    other_arrival = other_to_go / np.maximum(theirs, _LEAST_MPS)
    other_gone = other_to_leave / np.maximum(theirs, _LEAST_MPS)
    other_gone = np.where(crossings.is_merge, other_arrival, other_gone)
    is_inside = (other_to_go <= 0) & (other_to_leave > 0) & ~crossings.is_merge
    comes = (theirs > _LEAST_MPS) & (other_to_go > 0)
    later = (arrival > other_arrival) | ((arrival == other_arrival) & (row > other))
    can_stop = to_go > mine**2 / (2 * 6.0)
    yields = (is_inside | (comes & later)) & (to_go > 0) & can_stop
    yields &= arrival < other_gone + TIME_MARGIN_S
    gap = np.where(yields, to_go + 1.0, np.inf)
    affordable = np.full(len(rows), ACCELERATION_MPS2)
    np.minimum.at(
        affordable,
        crossings.driver,
        following_acceleration(mine, gap, np.zeros(len(gap))),
    )
    return affordable


@dataclass(frozen=True, kw_only=True, eq=False)
class Traffic(BoxStates):
    """A agents from the current step on; the simulation writes into the arrays."""

    velocity_mps: Float[np.ndarray, "A T 2"]

    def copy(self) -> "Traffic":
        """Deep copy."""
        return Traffic(
            **{field.name: getattr(self, field.name).copy() for field in fields(self)}
        )

    def now(self, step: int) -> MovingBoxes:
        """Boxes and velocities of all agents at one step."""
        return MovingBoxes(
            position_m=self.position_m[:, step],
            heading_rad=self.heading_rad[:, step],
            size_m=self.size_m,
            velocity_mps=self.velocity_mps[:, step],
            exists=self.is_valid[:, step],
        )


def initial_traffic(scenario: Scenario, is_generated: Bool[np.ndarray, "A"]) -> Traffic:
    """Traffic before the simulation: generated agents have constant velocity.

    Other agents keep their trajectories. Agents that exist now but have no trajectory,
    as in the test split, have constant velocity too; static objects stay.
    """
    agents, step = scenario.agents, scenario.current_step
    position = agents.position_m[:, step:].copy()
    heading = agents.heading_rad[:, step:].copy()
    velocity = agents.velocity_mps[:, step:].copy()
    exists = agents.is_valid[:, step:].copy()
    time_s = scenario.time_axis.times_s()[step:]
    goes_on = is_generated | (exists[:, 0] & ~exists[:, 1:].any(axis=1))
    is_static = ~agents.kind_mask(ROAD_USER_KINDS)
    now = np.where(is_static[goes_on, None, None], 0.0, velocity[goes_on, :1])
    position[goes_on] = position[goes_on, :1] + time_s[:, None] * now
    velocity[goes_on] = now
    heading[goes_on] = heading[goes_on, :1]
    exists[goes_on] = True
    return Traffic(
        position_m=position,
        heading_rad=heading,
        velocity_mps=velocity,
        is_valid=exists,
        size_m=agents.size_m,
    )


def simulate(
    traffic: Traffic, drivers: Drivers, wants: Intentions, axis: TimeAxis
) -> Iterator[int]:
    """Simulate the drivers up to the last step into ``traffic``; yields each step."""
    rows, paths, step_s = drivers.row, wants.paths, axis.step_s
    tracks, travelled = _tracks(traffic, drivers, wants)
    crossings = find_crossings(tracks, rows, traffic.size_m[:, 1])
    num_points = paths.heading_rad.shape[1]
    every = np.arange(len(rows))
    place, speed = np.zeros(len(rows)), drivers.speed_mps.copy()
    for step in range(axis.num_future_steps):
        yield step
        boxes = traffic.now(step)
        speeds = np.hypot(boxes.velocity_mps[:, 0], boxes.velocity_mps[:, 1])
        travelled[rows, step], speeds[rows] = place, speed
        acceleration = np.minimum(
            leaders_acceleration(paths, place, speed, rows, boxes),
            yielding_acceleration(
                crossings, rows, travelled[:, step], speeds, traffic.size_m[:, 0]
            ),
        )
        here = np.minimum((place / SPACING_M).astype(int), num_points - 1)
        ahead = ((place + speed * RESPONSE_S) / SPACING_M).astype(int)
        limit = np.minimum(
            paths.speed_limit_mps[every, here],
            paths.speed_limit_mps[every, np.minimum(ahead, num_points - 1)],
        )
        desired = np.where(step * step_s < wants.delay_s, 0.0, wants.desired_speed_mps)
        free = (np.minimum(limit, desired) - speed) / RESPONSE_S
        free = np.clip(free, -MAX_BRAKING_MPS2, ACCELERATION_MPS2)
        change = np.clip(np.minimum(free, acceleration), -HARDEST_BRAKING_MPS2, None)
        new = np.maximum(speed + change * step_s, 0.0)
        new = np.where(wants.is_parked, 0.0, new)
        moved = np.where(wants.is_parked, 0.0, (speed + new) / 2 * step_s)
        place, speed = place + moved, new
        _place(traffic, drivers, wants, place, speed, step + 1)
    if len(rows):
        traffic.velocity_mps[rows] = velocity_of(
            traffic.position_m[rows], drivers.velocity_mps, step_s
        )


def _place(
    traffic: Traffic,
    drivers: Drivers,
    wants: Intentions,
    place_m: Float[np.ndarray, "D"],
    speed_mps: Float[np.ndarray, "D"],
    step: int,
) -> None:
    rows = drivers.row
    position, heading = wants.paths.pose_at(np.arange(len(rows)), place_m[:, None])
    position, heading = position[:, 0], heading[:, 0]
    traffic.position_m[rows, step] = position
    traffic.heading_rad[rows, step] = heading
    traffic.velocity_mps[rows, step, 0] = speed_mps * np.cos(heading)
    traffic.velocity_mps[rows, step, 1] = speed_mps * np.sin(heading)


def _tracks(
    traffic: Traffic, drivers: Drivers, wants: Intentions
) -> tuple[Tracks, Float[np.ndarray, "A H"]]:
    """Paths of all agents, and the distance travelled along them at each step."""
    step = np.diff(traffic.position_m, axis=1)
    length = np.hypot(step[..., 0], step[..., 1])
    length *= traffic.is_valid[:, 1:] & traffic.is_valid[:, :-1]
    travelled = np.zeros(traffic.heading_rad.shape)
    np.cumsum(length, axis=1, out=travelled[:, 1:])
    shape = (len(travelled), NUM_SEARCHED)
    x, y, heading = (np.full(shape, np.nan) for _ in range(3))
    grid = np.arange(NUM_SEARCHED) * SPACING_M
    # Agents with a shorter path count as stationary in the search for crossings.
    for row in np.flatnonzero(travelled[:, -1] > 1.0):
        there = traffic.is_valid[row]
        along = travelled[row, there]
        for values, track in (
            (traffic.position_m[row, there, 0], x),
            (traffic.position_m[row, there, 1], y),
            (np.unwrap(traffic.heading_rad[row, there]), heading),
        ):
            track[row] = np.interp(grid, along, values, right=np.nan)
    rows, parked = drivers.row, wants.is_parked[:, None]
    count = min(NUM_SEARCHED, wants.paths.heading_rad.shape[1])
    for values, track in (
        (wants.paths.x_m, x),
        (wants.paths.y_m, y),
        (wants.paths.heading_rad, heading),
    ):
        track[rows] = np.nan
        track[rows, :count] = np.where(parked, np.nan, values[:, :count])
    return Tracks(x_m=x, y_m=y, heading_rad=heading), travelled


class LaneFollower:
    """Generator in which drivers follow lane routes, keep their gaps and yield.

    Pedestrians and static objects keep their velocity. It places no new agents.
    """

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        return "lane-follower"

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress, return the traffic.

        Raises:
            GenerationError: new agents are asked for, or the request is no good.
            EditError: an agent is not in the scenario.
        """
        began = time.perf_counter()
        rows = _checked_rows(request)
        scenario = request.scenario
        asked = np.zeros(len(scenario.agents), bool)
        asked[rows] = True
        drives = asked & scenario.agents.kind_mask(LANE_FOLLOWER_KINDS)
        drivers = drivers_at(scenario, np.flatnonzero(drives))
        initial = initial_traffic(scenario, asked)
        samples: list[TrafficSample] = []
        for index in range(request.num_samples):
            random = np.random.default_rng([request.scene_seed, index])
            wants = sample_intentions(drivers, len(scenario.agents), random)
            traffic = initial.copy()
            steps = simulate(traffic, drivers, wants, scenario.time_axis)
            yield from _reports(steps, index, request)
            motion = (getattr(traffic, name)[rows] for name in MOTION)
            samples.append(TrafficSample.of(scenario.agents.taken(rows), motion))
        return GeneratedTraffic(
            samples=tuple(samples),
            generator=self.name,
            seed=request.seed,
            elapsed_s=time.perf_counter() - began,
            notes=_notes(request, drivers),
        )


def _checked_rows(request: GenerationRequest) -> Int[np.ndarray, "G"]:
    if request.samples_states:
        raise GenerationError(
            "The lane follower cannot place new agents; place them by hand, or choose "
            "a learned model."
        )
    locks = request.scenario.locks
    for name in request.agent_ids:
        if name in locks and locks[name].keeps == "beginning":
            raise GenerationError(
                f"The {locks[name].in_words} of agent {name} is locked, which the lane "
                "follower cannot go on from; lock the whole trajectory, or choose a "
                "learned model."
            )
    if len(set(request.agent_ids)) < len(request.agent_ids):
        raise GenerationError("An agent was requested twice; each may be named once.")
    agents = request.scenario.agents
    rows = agents.rows(request.agent_ids)
    exists: Bool[np.ndarray, "G"] = agents.is_valid[rows, request.scenario.current_step]
    if not exists.all():
        missing = request.agent_ids[int(np.argmin(exists))]
        raise GenerationError(
            f"Agent {missing} is not there at the current step, so it has no state to "
            "go on from."
        )
    return rows


def _reports(
    steps: Iterator[int], sample: int, request: GenerationRequest
) -> Iterator[GenerationProgress]:
    total = max(request.scenario.time_axis.num_future_steps, 1)
    for step in steps:
        if step % 10 == 0:
            yield GenerationProgress(
                fraction=(sample + step / total) / request.num_samples,
                message=f"Sample {sample + 1} of {request.num_samples}",
            )


def _notes(request: GenerationRequest, drivers: Drivers) -> tuple[str, ...]:
    notes: list[str] = []
    off_lane = np.setdiff1d(np.arange(len(drivers.kinds)), drivers.choice.agent)
    off_lane = off_lane[drivers.speed_mps[off_lane] > MOVING_MPS]
    if len(off_lane):
        ids = ", ".join(
            request.scenario.agents.ids[row] for row in drivers.row[off_lane]
        )
        notes.append(f"No lane near agents {ids}; they go straight on.")
    if request.guidance or request.terms:
        notes.append("The lane follower takes no guidance.")
    return tuple(notes)
