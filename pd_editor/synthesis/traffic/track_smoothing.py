"""Smooth tracks of box centres, made of SUMO's states."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.synthesis.sumo.floating_car_data import RawTracks, center_of_front
from pd_editor.synthesis.traffic.vehicle_types import DrawnType

VEHICLE_SMOOTHING_S: Final = 0.3
"""Standard deviation of the filter that rounds the corners of SUMO's lanes."""

PEDESTRIAN_SMOOTHING_S: Final = 0.5
"""The same for pedestrians, whom SUMO moves sideways from stripe to stripe."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficTracks:
    """A road users, each at consecutive steps; P rows of all of them in a row."""

    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    size_m: Float[np.ndarray, "A 2"]
    first_step: Int[np.ndarray, "A"]
    first_row: Int[np.ndarray, "A_plus_1"]
    position_m: Float[np.ndarray, "P 2"]
    heading_rad: Float[np.ndarray, "P"]
    velocity_mps: Float[np.ndarray, "P 2"]

    @cached_property
    def agent(self) -> Int[np.ndarray, "P"]:
        """Agent of each row."""
        return np.repeat(np.arange(len(self.ids)), np.diff(self.first_row))

    @cached_property
    def step(self) -> Int[np.ndarray, "P"]:
        """Step of each row."""
        row = np.arange(len(self.position_m))
        return self.first_step[self.agent] + row - self.first_row[self.agent]

    def taken(self, wanted: Bool[np.ndarray, "A"]) -> "TrafficTracks":
        """Only some of the road users."""
        rows = wanted[self.agent]
        kept = np.flatnonzero(wanted)
        counts = np.diff(self.first_row)[kept]
        return TrafficTracks(
            ids=tuple(self.ids[agent] for agent in kept),
            kinds=tuple(self.kinds[agent] for agent in kept),
            size_m=self.size_m[kept],
            first_step=self.first_step[kept],
            first_row=np.concatenate([[0], np.cumsum(counts)]).astype(int),
            position_m=self.position_m[rows],
            heading_rad=self.heading_rad[rows],
            velocity_mps=self.velocity_mps[rows],
        )

    def joined(self, other: "TrafficTracks") -> "TrafficTracks":
        """These road users, and after them others in the same recording."""
        return TrafficTracks(
            ids=(*self.ids, *other.ids),
            kinds=(*self.kinds, *other.kinds),
            size_m=np.concatenate([self.size_m, other.size_m]),
            first_step=np.concatenate([self.first_step, other.first_step]),
            first_row=np.concatenate(
                [self.first_row, self.first_row[-1] + other.first_row[1:]]
            ),
            position_m=np.concatenate([self.position_m, other.position_m]),
            heading_rad=np.concatenate([self.heading_rad, other.heading_rad]),
            velocity_mps=np.concatenate([self.velocity_mps, other.velocity_mps]),
        )


def traffic_tracks(
    raw: RawTracks, types: dict[str, DrawnType], step_s: float
) -> TrafficTracks:
    """Tracks of box centres; whoever was away for a while continues as another."""
    begins = np.ones(len(raw.agent), bool)
    begins[1:] = (np.diff(raw.agent) != 0) | (np.diff(raw.step) != 1)
    first = np.append(np.flatnonzero(begins), len(raw.agent)).astype(int)
    sumo_agent = raw.agent[first[:-1]]
    part = np.arange(len(sumo_agent)) - np.searchsorted(sumo_agent, sumo_agent)
    drawn = [types[raw.names[agent]] for agent in sumo_agent]
    size_m = np.array([one.size_m for one in drawn], float).reshape(-1, 2)
    walks = np.array([one.kind is AgentKind.PEDESTRIAN for one in drawn], bool)
    agent = np.repeat(np.arange(len(drawn)), np.diff(first))
    length = np.where(walks, 0.0, size_m[:, 0])[agent]
    position = center_of_front(raw.front_m, raw.heading_rad, length)
    turn = wrap_angle(np.diff(raw.heading_rad, prepend=raw.heading_rad[:1]))
    heading = np.cumsum(turn) + (raw.heading_rad[0] if len(turn) else 0.0)
    state = np.column_stack([position, heading])
    spread = np.where(walks, PEDESTRIAN_SMOOTHING_S, VEHICLE_SMOOTHING_S) / step_s
    state = _smoothed(state, first, spread)
    velocity = _rate(state[:, :2], first, step_s)
    heading = wrap_angle(state[:, 2])
    return TrafficTracks(
        ids=tuple(
            raw.names[name] + (f"-{number}" if number else "")
            for name, number in zip(sumo_agent, part, strict=True)
        ),
        kinds=tuple(one.kind for one in drawn),
        size_m=size_m,
        first_step=raw.step[first[:-1]],
        first_row=first,
        position_m=state[:, :2],
        heading_rad=np.where(
            walks[agent], _walking_heading(heading, velocity, first), heading
        ),
        velocity_mps=velocity,
    )


def _smoothed(
    values: Float[np.ndarray, "P D"],
    first: Int[np.ndarray, "A_plus_1"],
    spread_steps: Float[np.ndarray, "A"],
) -> Float[np.ndarray, "P D"]:
    """Each track under a Gaussian filter; both ends stay where they are.

    Beyond its ends a track goes on as its point reflection, so that one of even
    speed is not changed at all.
    """
    agent = np.repeat(np.arange(len(first) - 1), np.diff(first))
    low, high = first[:-1][agent], first[1:][agent] - 1
    row = np.arange(len(values))
    reach = int(np.ceil(3 * spread_steps.max(initial=0.0)))
    total = np.zeros_like(values)
    weights = np.zeros(len(values))
    for shift in range(-reach, reach + 1):
        weight = np.exp(-0.5 * (shift / spread_steps[agent]) ** 2)
        at = row + shift
        end = np.clip(at, low, high)
        beyond = at - end
        mirrored = np.clip(end - beyond, low, high)
        reflected = 2 * values[end] - values[mirrored]
        value = np.where((beyond == 0)[:, None], values[mirrored], reflected)
        total += weight[:, None] * value
        weights += weight
    return total / np.maximum(weights, 1e-12)[:, None]


def _rate(
    position: Float[np.ndarray, "P 2"],
    first: Int[np.ndarray, "A_plus_1"],
    step_s: float,
) -> Float[np.ndarray, "P 2"]:
    """Central differences, one-sided at the ends of tracks; 0 for a single row."""
    agent = np.repeat(np.arange(len(first) - 1), np.diff(first))
    row = np.arange(len(position))
    after = np.minimum(row + 1, first[1:][agent] - 1)
    before = np.maximum(row - 1, first[:-1][agent])
    time = np.maximum(after - before, 1) * step_s
    return (position[after] - position[before]) / time[:, None]


def _walking_heading(
    heading: Float[np.ndarray, "P"],
    velocity: Float[np.ndarray, "P 2"],
    first: Int[np.ndarray, "A_plus_1"],
) -> Float[np.ndarray, "P"]:
    """Direction of the motion; who stands looks where he or she went last."""
    moves = np.hypot(velocity[:, 0], velocity[:, 1]) > STANDING_MPS
    row = np.arange(len(heading))
    last = np.maximum.accumulate(np.where(moves, row, -1))
    start = np.repeat(first[:-1], np.diff(first))
    has_moved = last >= start
    return np.where(has_moved, heading_of(velocity)[np.maximum(last, 0)], heading)
