"""Joint selection of trajectories: the combination of modes with the fewest collisions."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_collide
from pd_editor.scene.geometry.oriented_box import Boxes

_STRIDE: Final = 2
"""Stride of the steps at which boxes are compared."""
_MAX_ROUNDS: Final = 4


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
    for _ in range(_MAX_ROUNDS):
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
