"""Collisions of boxes now and later, centres within 2 m, and distances to other agents."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.collisions.box_tests import (
    overlaps_of_pairs,
    pairs_that_meet,
)
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import (
    MetricValues,
    any_step,
    mean_over_steps,
    measured,
)
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import unit_vector

COLLISION_M: Final = 2.0
PEDESTRIAN_COLLISION_M: Final = 1.0
"""Collision distance of two pedestrians."""

NUM_NEIGHBORS: Final = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxOverlap:
    """Overlaps of A evaluated agents with any agent at H steps, the current one first."""

    is_valid: Bool[np.ndarray, "A H"]
    is_overlapping: Bool[np.ndarray, "A H"]
    is_new: Bool[np.ndarray, "A H"]
    """Overlaps of pairs that do not overlap at the current step."""

    def at_state(self) -> MetricValues:
        """Metric ``init_overlap`` [A]."""
        return measured("init_overlap", self.is_overlapping[:, 0], self.is_valid[:, 0])

    def newly(self) -> MetricValues:
        """Metric ``new_overlap`` [A]."""
        return any_step("new_overlap", self.is_new[:, 1:], self.is_valid[:, 1:])

    def new_steps(self) -> MetricValues:
        """Metric ``new_overlap_steps`` [A]."""
        return mean_over_steps(
            "new_overlap_steps", self.is_new[:, 1:], self.is_valid[:, 1:]
        )


def box_overlap(view: TrafficView) -> BoxOverlap:
    """Overlaps of the evaluated agents with each other and with context agents.

    Pairs of pedestrians do not count, since they walk in groups.
    """
    everyone = view.everyone
    num_agents, num_steps = len(view), view.num_steps
    pairs = pairs_that_meet(everyone.position_m, everyone.is_valid, everyone.radius_m)
    pairs = pairs[pairs_that_matter(everyone, pairs) & (pairs[:, 0] < num_agents)]
    pair, at = overlaps_of_pairs(pairs, everyone)
    hit = np.zeros((len(pairs), num_steps), bool)
    hit[pair, at] = True
    is_new = hit & ~hit[:, :1]
    return BoxOverlap(
        is_valid=view.agents.is_valid,
        is_overlapping=_of_agents(hit, pairs, num_agents),
        is_new=_of_agents(is_new, pairs, num_agents),
    )


def pairs_that_matter(
    agents: AgentStates, pairs: Int[np.ndarray, "P 2"]
) -> Bool[np.ndarray, "P"]:
    """Whether pairs count: both are road users, and not both are pedestrians."""
    walks = agents.is_in("pedestrians")
    is_road_user = agents.group >= 0
    a, b = pairs[:, 0], pairs[:, 1]
    return is_road_user[a] & is_road_user[b] & ~(walks[a] & walks[b])


def _of_agents(
    hit: Bool[np.ndarray, "P H"], pairs: Int[np.ndarray, "P 2"], num_agents: int
) -> Bool[np.ndarray, "A H"]:
    """Hits of pairs, assigned to both agents of each."""
    result = np.zeros((num_agents, hit.shape[1]), bool)
    for side in (0, 1):
        evaluated = pairs[:, side] < num_agents
        np.logical_or.at(result, pairs[evaluated, side], hit[evaluated])
    return result


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


def init_five_circles(view: TrafficView) -> MetricValues:
    """Whether circles of each motor vehicle and of another one meet [A].

    Source: Rowe et al., Scenario Dreamer, 2025, and the bound of its code.
    """
    everyone = view.everyone
    counts = everyone.is_in("movers") & everyone.is_valid[:, 0]
    length, width = everyone.size_m.T
    along = ((length - width) / 2)[:, None] * np.linspace(-1, 1, 5)
    ahead = unit_vector(everyone.heading_rad[:, :1])
    center = everyone.position_m[:, :1] + along[..., None] * ahead
    reach = width / np.sqrt(3.8)
    pairs = pairs_that_meet(center, np.repeat(counts[:, None], 5, axis=1), reach)
    a, b = pairs.T
    apart = np.linalg.norm(center[a, :, None] - center[b, None], axis=-1)
    meet = (apart < (reach[a] + reach[b])[:, None, None]).any(axis=(1, 2))
    hit = _of_agents(meet[:, None], pairs, len(view))[:, 0]
    return measured("init_five_circles", hit, counts[: len(view)])


def _reach_m(walks: Bool[np.ndarray, "A"]) -> Float[np.ndarray, "A"]:
    return np.where(walks, PEDESTRIAN_COLLISION_M, COLLISION_M)


def nearest_distance(view: TrafficView) -> MetricValues:
    """Distance to the nearest other centre [A]; 0 without one, as in the paper."""
    nearest = np.min(_distances_m(view), axis=1, initial=np.inf)
    return measured(
        "nearest_distance",
        np.where(np.isfinite(nearest), nearest, 0.0),
        view.agents.is_valid[:, 0],
    )


def local_density(view: TrafficView) -> MetricValues:
    """The smallest distances to others, sorted [A 5]; valid as far as there are others."""
    distance = np.sort(_distances_m(view), axis=1)[:, :NUM_NEIGHBORS]
    missing = NUM_NEIGHBORS - distance.shape[1]
    distance = np.pad(distance, ((0, 0), (0, missing)), constant_values=np.inf)
    is_valid = np.isfinite(distance) & view.agents.is_valid[:, :1]
    return measured("local_density", np.where(is_valid, distance, 0.0), is_valid)


def _distances_m(view: TrafficView) -> Float[np.ndarray, "A B"]:
    """Distances to agents of the same group; infinite to oneself and other groups."""
    agents, everyone = view.agents, view.everyone
    offset = agents.position_m[:, None, 0] - everyone.position_m[None, :, 0]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    counts = agents.group[:, None] == everyone.group
    counts &= everyone.is_valid[:, 0] & (everyone.group >= 0)
    np.fill_diagonal(counts, False)
    return np.where(counts, distance, np.inf)
