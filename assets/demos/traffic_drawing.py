"""Traffic for drawn roads: car following (IDM, Treiber 2000) along lanes, in steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pd_editor.geometry.angles import heading_of
from pd_editor.geometry.polyline import arc_length, point_at, without_repeats
from pd_editor.scene.agent_kind import AgentCategory, AgentKind, default_sizes_m
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.time_axis import TimeAxis

WARM_UP_S = 3.0
SUBSTEPS = 2
ACCELERATION = 1.8
BRAKING = 2.2
HARDEST_BRAKING = 3.2
TIME_GAP_S = 1.2
STANDING_GAP_M = 2.0
LATERAL_ACCELERATION = 2.2
LOOK_AHEAD_M = 70.0
GRID_M = 0.5


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A stop line at the end of a lane, closed for a time (clip seconds)."""

    lane: str
    closed_from_s: float
    closed_until_s: float


@dataclass(frozen=True, kw_only=True)
class RoadUser:
    """Someone who follows a line; standing if the speed is zero."""

    agent_id: str
    line: Float[np.ndarray, "N 2"]
    start_m: float
    """Place on the line when the clip begins, as if nobody were in the way."""
    speed: float
    """Speed at the beginning, and the one that is wished for."""
    kind: AgentKind = AgentKind.VEHICLE
    size_m: tuple[float, float] | None = None
    category: AgentCategory = AgentCategory.UNSCORED
    stops: tuple[tuple[float, float, float], ...] = ()
    """Place on the line, closed from, closed until."""
    starts_at_s: float | None = None
    """Stands before this time; None if under way."""


def along_lanes(
    lanes: Mapping[str, Float[np.ndarray, "N 2"]],
    route: Sequence[str],
    stops: Sequence[Stop] = (),
) -> tuple[Float[np.ndarray, "N 2"], tuple[tuple[float, float, float], ...]]:
    """A route's line, and its stop lines as places on it."""
    line = without_repeats(np.concatenate([lanes[name] for name in route]), 0.05)
    length = np.cumsum([arc_length(lanes[name])[-1] for name in route])
    places = [
        (float(length[route.index(stop.lane)]), stop.closed_from_s, stop.closed_until_s)
        for stop in stops
        if stop.lane in route
    ]
    return line, tuple(places)


class _Mover:
    """A road user under way."""

    def __init__(self, user: RoadUser, size_m: Float[np.ndarray, "2"]) -> None:
        self.user, self.size = user, size_m
        length = arc_length(user.line)[-1]
        self.grid = np.arange(0.0, length, GRID_M)
        self.fine = point_at(user.line, self.grid)
        self.allowed = self._speed_profile()
        waits = user.starts_at_s is not None
        self.speed = 0.0 if waits else min(user.speed, self.allowed[0])
        self.along = user.start_m - (0.0 if waits else WARM_UP_S * self.speed)
        self.is_walking = user.kind == AgentKind.PEDESTRIAN
        self.push = 0.0
        self.move(0.0)

    def _speed_profile(self) -> Float[np.ndarray, "M"]:
        """Wished speed at each place, lower in and ahead of bends."""
        reach = 3.0 if self.user.kind != AgentKind.PEDESTRIAN else 0.5
        heading = np.unwrap(
            heading_of(self._at(self.grid + reach) - self._at(self.grid))
        )
        change = np.abs(np.gradient(heading, self.grid))
        kernel = np.ones(7) / 7
        bend = np.convolve(np.pad(change, 3, mode="edge"), kernel, "valid")
        limit = np.minimum(
            np.sqrt(LATERAL_ACCELERATION / np.maximum(bend, 1e-4)), self.user.speed
        )
        budget = limit**2 + 2 * 1.4 * self.grid
        ahead = np.minimum.accumulate(budget[::-1])[::-1]
        return np.sqrt(np.maximum(ahead - 2 * 1.4 * self.grid, 0.01))

    def _at(self, along: Float[np.ndarray, "M"]) -> Float[np.ndarray, "M 2"]:
        """Places on the line, straight on beyond its ends."""
        inside = np.clip(along, self.grid[0], self.grid[-1])
        start, end = self.fine[1] - self.fine[0], self.fine[-1] - self.fine[-2]
        points = point_at(self.fine, inside)
        before = np.minimum(along - self.grid[0], 0.0)[:, None] * start / GRID_M
        after = np.maximum(along - self.grid[-1], 0.0)[:, None] * end / GRID_M
        return points + before + after

    def move(self, step_s: float) -> None:
        """Drive on with the acceleration at hand."""
        before = self.speed
        self.speed = max(before + self.push * step_s, 0.0)
        self.along += (before + self.speed) / 2 * step_s
        self.center, self.heading = self._pose()

    def _pose(self) -> tuple[Float[np.ndarray, "2"], float]:
        """Centre and heading; both axles are on the line."""
        half = max(self.size[0] * 0.3, 0.2)
        rear, front = self._at(np.array([self.along - half, self.along + half]))
        return (rear + front) / 2, float(heading_of((front - rear)[None])[0])

    def obstacles(
        self, others: Sequence["_Mover"], time_s: float
    ) -> list[tuple[float, float]]:
        """Gap and speed of whoever and whatever is ahead on the line."""
        first = int(np.searchsorted(self.grid, self.along, "right"))
        ahead = self.fine[first : first + round(LOOK_AHEAD_M / GRID_M)]
        found = []
        if len(ahead) and others:
            centers = np.array([other.center for other in others])
            distance = np.linalg.norm(centers[:, None] - ahead, axis=-1)
            nearest = distance.argmin(axis=1)
            for other, k, beside in zip(
                others, nearest, distance.min(axis=1), strict=True
            ):
                if beside < (self.size[1] + other.size[1]) / 2 + 0.4:
                    length = (self.size[0] + other.size[0]) / 2
                    gap = self.grid[first + k] - self.along - length
                    found.append((float(gap), other.speed))
        for place, closed_from, closed_until in self.user.stops:
            gap = place - self.along - self.size[0] / 2 - 0.5
            can_stop = self.speed**2 <= 2 * HARDEST_BRAKING * max(gap, 0.0) + 0.05
            if closed_from <= time_s < closed_until and gap > -0.6 and can_stop:
                found.append((gap + STANDING_GAP_M - 0.5, 0.0))
        return found

    def acceleration(self, movers: Sequence["_Mover"], time_s: float) -> float:
        """Intelligent Driver Model."""
        if self.user.starts_at_s is not None and time_s < self.user.starts_at_s:
            return 0.0
        others = [] if self.is_walking else [m for m in movers if m is not self]
        wished = max(float(np.interp(self.along, self.grid, self.allowed)), 0.3)
        free = 1 - (self.speed / wished) ** 4
        hold = 0.0
        for gap, speed in self.obstacles(others, time_s):
            closing = self.speed * (self.speed - speed)
            desired = STANDING_GAP_M + max(
                self.speed * TIME_GAP_S
                + closing / (2 * np.sqrt(ACCELERATION * BRAKING)),
                0.0,
            )
            hold = max(hold, (desired / max(gap, 0.3)) ** 2)
        wanted = ACCELERATION * (free - hold)
        return float(np.clip(wanted, -HARDEST_BRAKING - 0.8, ACCELERATION))


def drawn_tracks(users: Sequence[RoadUser], time_axis: TimeAxis) -> AgentTracks:
    """Tracks of all road users over a clip."""
    kinds = tuple(user.kind for user in users)
    size = default_sizes_m(kinds)
    for row, user in enumerate(users):
        size[row] = user.size_m or size[row]
    movers = [_Mover(user, size[row]) for row, user in enumerate(users)]
    drivers = [mover for mover in movers if not mover.is_walking]
    step_s = time_axis.step_s / SUBSTEPS
    num_steps = time_axis.num_steps
    poses = np.zeros((len(users), num_steps, 3))
    speeds = np.zeros((len(users), num_steps))
    for tick in range(-round(WARM_UP_S / step_s), num_steps * SUBSTEPS):
        step, is_between = divmod(tick, SUBSTEPS)
        if step >= 0 and not is_between:
            for row, mover in enumerate(movers):
                poses[row, step] = (*mover.center, mover.heading)
                speeds[row, step] = mover.speed
        for mover in movers:
            if mover.user.speed > 0:
                change = mover.acceleration(drivers, tick * step_s) - mover.push
                mover.push += float(np.clip(change, -10 * step_s, 6 * step_s))
        for mover in movers:
            mover.move(step_s)
    return _tracks(users, size, poses, speeds, time_axis)


def _tracks(
    users: Sequence[RoadUser],
    size_m: Float[np.ndarray, "A 2"],
    poses: Float[np.ndarray, "A T 3"],
    speeds: Float[np.ndarray, "A T"],
    time_axis: TimeAxis,
) -> AgentTracks:
    position = np.round(poses[..., :2], 4)
    change = np.gradient(poses[..., :2], time_axis.step_s, axis=1)
    direction = heading_of(change)
    direction = np.where(speeds > 0.05, direction, poses[..., 2])
    velocity = speeds[..., None] * np.stack(
        [np.cos(direction), np.sin(direction)], axis=-1
    )
    shape = (len(users), time_axis.num_steps)
    steps = np.arange(time_axis.num_steps)
    return AgentTracks(
        ids=tuple(user.agent_id for user in users),
        kinds=tuple(user.kind for user in users),
        categories=tuple(user.category for user in users),
        size_m=size_m,
        has_known_size=np.ones(len(users), bool),
        position_m=position,
        heading_rad=np.round(poses[..., 2], 5),
        velocity_mps=np.round(velocity, 4),
        is_valid=np.ones(shape, bool),
        observed=np.broadcast_to(steps < time_axis.current_step, shape).copy(),
    )
