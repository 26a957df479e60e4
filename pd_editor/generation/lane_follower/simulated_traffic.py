"""State and simulation of all agents of a scene over the steps after the current one."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.generation.lane_follower.crossings import (
    NUM_SEARCHED,
    Tracks,
    find_crossings,
    yielding_acceleration,
)
from pd_editor.generation.lane_follower.intentions import Drivers, Intentions
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.geometry.oriented_box import BoxStates
from pd_editor.scene.paths.car_following import (
    ACCELERATION_MPS2,
    HARDEST_BRAKING_MPS2,
    MovingBoxes,
    leaders_acceleration,
)
from pd_editor.scene.paths.driving_paths import SPACING_M, velocity_of
from pd_editor.scene.paths.retiming import MAX_BRAKING_MPS2, RESPONSE_S
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis

_LEAST_TRACK_M = 1.0
"""Agents with a shorter path count as stationary in the search for crossings."""


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
    for row in np.flatnonzero(travelled[:, -1] > _LEAST_TRACK_M):
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
