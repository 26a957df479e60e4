"""The paper's collision rule: the centre of another agent within 2 m.

Boxes are ignored: two cars bumper to bumper do not collide. The paper's code also
compares agents of different scenes of a batch; this module does not.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.collisions.box_tests import pairs_that_meet
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, mean_over_steps, measured

COLLISION_M: Final = 2.0
PEDESTRIAN_COLLISION_M: Final = 1.0
"""Collision distance of two pedestrians."""


def init_collision_2m(view: TrafficView) -> MetricValues:
    """Whether each agent collides at the current step [A]."""
    return measured(
        "init_collision_2m", _collides(view, 1)[:, 0], view.agents.is_valid[:, 0]
    )


def actor_collision_2m(view: TrafficView) -> MetricValues:
    """Share of each agent's steps in collision [A], the current step included.

    The mean over agents that exist at all steps is the paper's actorCR.
    """
    return mean_over_steps(
        "actor_collision_2m", _collides(view, view.num_steps), view.agents.is_valid
    )


def _collides(view: TrafficView, num_steps: int) -> Bool[np.ndarray, "A S"]:
    """Whether another centre of the same group is within the group's distance."""
    everyone = view.everyone
    position = everyone.position_m[:, :num_steps]
    is_valid = everyone.is_valid[:, :num_steps]
    reach = _reach_m(everyone.is_in("pedestrians"))
    # Half of the distance each, and a margin for rounding.
    pairs = pairs_that_meet(position, is_valid, reach / 2 + 1e-6)
    a, b = pairs[:, 0], pairs[:, 1]
    alike = (everyone.group[a] == everyone.group[b]) & (everyone.group[a] >= 0)
    a, b = a[alike], b[alike]
    offset = position[b] - position[a]
    hit = np.hypot(offset[..., 0], offset[..., 1]) <= reach[a, None]
    hit &= is_valid[a] & is_valid[b]
    result = np.zeros(is_valid.shape, bool)
    np.logical_or.at(result, a, hit)
    np.logical_or.at(result, b, hit)
    return result[: len(view)]


def _reach_m(walks: Bool[np.ndarray, "A"]) -> Float[np.ndarray, "A"]:
    return np.where(walks, PEDESTRIAN_COLLISION_M, COLLISION_M)
