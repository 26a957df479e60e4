"""Tracks of simulated road users: SUMO's states as smooth tracks, without its artefacts."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.experiments.recordings.recording import TrafficTracks
from pd_editor.experiments.synthesis.sumo.simulation_output import RawTracks
from pd_editor.experiments.synthesis.traffic.demand_config import SampledType
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.sumo_net import center_of_front
from pd_editor.scene.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.lines import numbered
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.thresholds import STANDING_MPS

VEHICLE_SMOOTHING_S: Final = 0.3
"""Standard deviation of the filter that smooths the corners of SUMO's lanes."""

PEDESTRIAN_SMOOTHING_S: Final = 0.5
"""The same for pedestrians, which SUMO moves sideways between discrete stripes."""


def traffic_tracks(
    raw: RawTracks, types: dict[str, SampledType], step_s: float
) -> TrafficTracks:
    """Tracks of box centres; a road user that was absent continues under a new id."""
    begins = np.ones(len(raw.agent), bool)
    begins[1:] = (np.diff(raw.agent) != 0) | (np.diff(raw.step) != 1)
    first = np.append(np.flatnonzero(begins), len(raw.agent)).astype(int)
    sumo_agent = raw.agent[first[:-1]]
    part = np.arange(len(sumo_agent)) - np.searchsorted(sumo_agent, sumo_agent)
    sampled = [types[raw.names[agent]] for agent in sumo_agent]
    size_m = np.array([one.size_m for one in sampled], float).reshape(-1, 2)
    walks = np.array([one.kind is AgentKind.PEDESTRIAN for one in sampled], bool)
    agent = np.repeat(np.arange(len(sampled)), np.diff(first))
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
        kinds=tuple(one.kind for one in sampled),
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
    """Smooth each track with a Gaussian filter; both ends stay fixed.

    Tracks are extended by point reflection, so that tracks of constant speed do not
    change.
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
    """Central differences, one-sided at the ends of tracks; 0 for a single state."""
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
    """Direction of motion; stationary pedestrians keep their last direction."""
    moves = np.hypot(velocity[:, 0], velocity[:, 1]) > STANDING_MPS
    row = np.arange(len(heading))
    last = np.maximum.accumulate(np.where(moves, row, -1))
    start = np.repeat(first[:-1], np.diff(first))
    has_moved = last >= start
    return np.where(has_moved, heading_of(velocity)[np.maximum(last, 0)], heading)


MAX_STEP_M: Final = 4.5
MAX_LATERAL_MPS2: Final = 6.0
MAX_LONGITUDINAL_MPS2: Final = 9.0
MIN_SPEED_MPS: Final = 1.0
"""Below this speed the direction of motion is not evaluated."""


def has_artefact(tracks: TrafficTracks, step_s: float) -> Bool[np.ndarray, "A"]:
    """Which agents jump, slip sideways, or exceed the friction of tyres."""
    same = tracks.agent[1:] == tracks.agent[:-1]
    moved = np.linalg.norm(np.diff(tracks.position_m, axis=0), axis=1)
    speed = np.linalg.norm(tracks.velocity_mps, axis=1)
    forward = unit_vector(tracks.heading_rad)
    along = np.sum(forward * tracks.velocity_mps, axis=1)
    drives = np.array([kind is not AgentKind.PEDESTRIAN for kind in tracks.kinds], bool)
    drift = np.arccos(np.clip(along / np.maximum(speed, 1e-9), -1.0, 1.0))
    # Largest angle between heading and motion.
    slips = drives[tracks.agent] & (speed > MIN_SPEED_MPS) & (drift > 0.6)
    change = np.diff(tracks.velocity_mps, axis=0) / step_s
    ahead = np.sum(change * forward[1:], axis=1)
    aside = forward[1:, 0] * change[:, 1] - forward[1:, 1] * change[:, 0]
    turns = np.abs(wrap_angle(np.diff(tracks.heading_rad))) / step_s * speed[1:]
    turns = np.where(drives[tracks.agent[1:]], turns, 0.0)
    bad = moved > MAX_STEP_M
    bad |= np.abs(ahead) > MAX_LONGITUDINAL_MPS2
    bad |= np.maximum(np.abs(aside), turns) > MAX_LATERAL_MPS2
    found = np.zeros(len(tracks.ids), bool)
    found[tracks.agent[1:][bad & same]] = True
    found[tracks.agent[slips]] = True
    return found


def overlapping_pairs(
    tracks: TrafficTracks, *, with_pedestrians: bool = False
) -> Int[np.ndarray, "Q 2"]:
    """Pairs of agents whose boxes overlap at any step, the earlier row first.

    Pairs of pedestrians count only ``with_pedestrians``.
    """
    pairs = _near_pairs(tracks)
    if not with_pedestrians:
        walks = np.array([kind is AgentKind.PEDESTRIAN for kind in tracks.kinds], bool)
        pairs = pairs[~walks[pairs].all(axis=1)]
    first = tracks.first_step[pairs].max(axis=1)
    count = np.maximum(tracks.end_step[pairs].min(axis=1) - first, 0)
    pair, index = numbered(count)
    step = first[pair] + index
    rows = (tracks.first_row[:-1] - tracks.first_step)[pairs[pair]] + step[:, None]
    reach = np.hypot(*tracks.size_m.T)[pairs].sum(axis=1)[pair] / 2
    gap = tracks.position_m[rows[:, 0]] - tracks.position_m[rows[:, 1]]
    close = np.einsum("pd,pd->p", gap, gap) < reach**2
    rows, pair = rows[close], pair[close]
    one, other = (
        Boxes(
            position_m=tracks.position_m[side],
            heading_rad=tracks.heading_rad[side],
            size_m=tracks.size_m[tracks.agent[side]],
        )
        for side in rows.T
    )
    return pairs[np.unique(pair[boxes_touch(one, other)])]


def _near_pairs(tracks: TrafficTracks) -> Int[np.ndarray, "Q 2"]:
    """Pairs that are near each other at any of the searched steps."""
    num_agents = len(tracks.ids)
    near = np.zeros((num_agents, num_agents), bool)
    reach = np.hypot(*tracks.size_m.T) / 2
    # Steps between two searches for pairs of near agents.
    looked = np.flatnonzero(tracks.step % 5 == 0)
    looked = looked[np.argsort(tracks.step[looked], kind="stable")]
    for rows in np.split(looked, np.flatnonzero(np.diff(tracks.step[looked])) + 1):
        agents, at = tracks.agent[rows], tracks.position_m[rows]
        gap = np.hypot(at[:, None, 0] - at[None, :, 0], at[:, None, 1] - at[None, :, 1])
        # Largest approach of two vehicles between two searches.
        limit = reach[agents][:, None] + reach[agents] + 12.0
        near[np.ix_(agents, agents)] |= gap < limit
    return np.argwhere(np.triu(near, 1))


def without_overlaps(tracks: TrafficTracks) -> Bool[np.ndarray, "A"]:
    """Which agents to keep so that no boxes overlap; those with most overlaps go first."""
    pairs = overlapping_pairs(tracks)
    stays = np.ones(len(tracks.ids), bool)
    while len(pairs):
        worst = int(np.bincount(pairs.ravel()).argmax())
        stays[worst] = False
        pairs = pairs[(pairs != worst).all(axis=1)]
    return stays
