"""Finds and removes artefacts of the simulator."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.experiments.synthesis.traffic.track_smoothing import TrafficTracks
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.geometry.lines import numbered
from pd_editor.scene.geometry.oriented_box import Boxes

MAX_STEP_M: Final = 4.5
MAX_LATERAL_MPS2: Final = 6.0
MAX_LONGITUDINAL_MPS2: Final = 9.0
MIN_SPEED_MPS: Final = 1.0
"""Below this speed the direction of motion is not evaluated."""
MAX_DRIFT_RAD: Final = 0.6
"""Largest angle between heading and motion."""

_PAIR_STRIDE: Final = 5
"""Steps between two searches for pairs of near agents."""
_PAIR_SLACK_M: Final = 12.0
"""Largest approach of two vehicles between two searches."""


def has_artefact(tracks: TrafficTracks, step_s: float) -> Bool[np.ndarray, "A"]:
    """Which agents jump, slip sideways, or exceed the friction of tyres."""
    same = tracks.agent[1:] == tracks.agent[:-1]
    moved = np.linalg.norm(np.diff(tracks.position_m, axis=0), axis=1)
    speed = np.linalg.norm(tracks.velocity_mps, axis=1)
    forward = unit_vector(tracks.heading_rad)
    along = np.sum(forward * tracks.velocity_mps, axis=1)
    drives = np.array([kind is not AgentKind.PEDESTRIAN for kind in tracks.kinds], bool)
    drift = np.arccos(np.clip(along / np.maximum(speed, 1e-9), -1.0, 1.0))
    slips = drives[tracks.agent] & (speed > MIN_SPEED_MPS) & (drift > MAX_DRIFT_RAD)
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
    end = tracks.first_step + np.diff(tracks.first_row)
    count = np.maximum(end[pairs].min(axis=1) - first, 0)
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
    looked = np.flatnonzero(tracks.step % _PAIR_STRIDE == 0)
    looked = looked[np.argsort(tracks.step[looked], kind="stable")]
    for rows in np.split(looked, np.flatnonzero(np.diff(tracks.step[looked])) + 1):
        agents, at = tracks.agent[rows], tracks.position_m[rows]
        gap = np.hypot(at[:, None, 0] - at[None, :, 0], at[:, None, 1] - at[None, :, 1])
        limit = reach[agents][:, None] + reach[agents] + _PAIR_SLACK_M
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
