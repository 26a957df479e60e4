"""Overlaps of boxes over time, centres within 2 m, and distances to other agents."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import (
    MetricValues,
    any_step,
    mean_over_steps,
    measured,
)
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.oriented_box import Boxes, BoxStates, overlap_area
from pd_editor.scene.geometry.path_pieces import bounds_m, rectangles_meet
from pd_editor.scene.scenario import Scenario

MIN_OVERLAP_M2: Final = 0.05
"""Boxes that share at most this area only touch."""
_PORTION: Final = 50_000
"""Number of pairs times steps per chunk."""


def boxes_collide(
    one: Boxes, other: Boxes, exist: Bool[np.ndarray, "*#s"] | None = None
) -> Bool[np.ndarray, "*s"]:
    """Whether boxes that exist share more than ``MIN_OVERLAP_M2``; shapes are broadcast."""
    offset = other.position_m - one.position_m
    found = (
        np.einsum("...d,...d->...", offset, offset)
        < (one.radius_m + other.radius_m) ** 2
    )
    if exist is not None:
        found &= exist
    one = one.broadcast_to(found.shape)[found]
    other = other.broadcast_to(found.shape)[found]
    touch = boxes_touch(one, other)
    unsure = np.flatnonzero(touch & ~_share_disc(one, other))
    area = overlap_area(one[unsure].corners_m(), other[unsure].corners_m())
    touch[unsure] = area > MIN_OVERLAP_M2
    found[found] = touch
    return found


def _share_disc(one: Boxes, other: Boxes) -> Bool[np.ndarray, "*s"]:
    """Whether boxes still touch without a border, so that they share a disc as wide."""
    # A disc of this radius has a larger area than ``MIN_OVERLAP_M2``.
    within = [replace(box, size_m=box.size_m - 2 * 0.13) for box in (one, other)]
    has_any = np.minimum(*(box.size_m.min(axis=-1) for box in within)) > 0
    return has_any & boxes_touch(*within)


def overlapping_pairs(agents: BoxStates, step: int) -> Int[np.ndarray, "P 2"]:
    """Pairs of rows, the lower one first, whose boxes overlap at a step."""
    pairs, _ = first_overlap(agents, np.array([step]))
    return pairs


def first_overlap(
    agents: BoxStates, steps: Int[np.ndarray, "S"]
) -> tuple[Int[np.ndarray, "P 2"], Int[np.ndarray, "P"]]:
    """Pairs of rows that overlap at any of the steps, and the first such step.

    ``steps`` must increase. Pairs are sorted by row, the lower one first.
    """
    boxes = agents.at_steps(steps)
    pairs = pairs_that_meet(boxes.position_m, boxes.is_valid, boxes.radius_m)
    first = np.full(len(pairs), -1)
    for part, some in _parts(len(pairs), boxes.num_steps):
        # Pairs that were found to overlap are not tested again.
        open_pairs = part[first[part] < 0]
        pair, at = overlaps_of_pairs(pairs[open_pairs], boxes.at_steps(some))
        found, index = np.unique(pair, return_index=True)
        first[open_pairs[found]] = some.start + at[index]
    overlaps = first >= 0
    return pairs[overlaps], np.asarray(steps)[first[overlaps]]


def _parts(num_pairs: int, num_steps: int) -> Iterator[tuple[np.ndarray, slice]]:
    """Chunks of pairs and steps that bound the memory, early steps first."""
    at_once = max(_PORTION // max(num_pairs, 1), 1)
    for start in range(0, num_steps, at_once):
        for low in range(0, num_pairs, _PORTION):
            high = min(low + _PORTION, num_pairs)
            yield np.arange(low, high), slice(start, start + at_once)


def pairs_that_meet(
    position_m: Float[np.ndarray, "A S 2"],
    is_valid: Bool[np.ndarray, "A S"],
    radius_m: Float[np.ndarray, "A"],
) -> Int[np.ndarray, "P 2"]:
    """Pairs whose swept discs have intersecting axis-aligned bounding boxes.

    Only the discs of such pairs can touch. Pairs are sorted by row, the lower one
    first.
    """
    low, high = bounds_m(position_m, is_valid)
    low, high = low - radius_m[:, None], high + radius_m[:, None]
    meet = rectangles_meet(low[:, None], high[:, None], low, high)
    return np.argwhere(np.triu(meet, 1))


def overlaps_of_pairs(
    pairs: Int[np.ndarray, "P 2"], boxes: BoxStates
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Indices of overlapping pairs and steps, sorted by pair, then by step."""
    a, b = pairs.T
    offset = boxes.position_m[b] - boxes.position_m[a]
    reach = (boxes.radius_m[a] + boxes.radius_m[b])[:, None]
    near = np.einsum("psd,psd->ps", offset, offset) < reach**2
    near &= boxes.is_valid[a] & boxes.is_valid[b]
    pair, at = np.nonzero(near)
    collide = boxes_collide(boxes.at(a[pair], at), boxes.at(b[pair], at))
    return pair[collide], at[collide]


def boxes_touch(one: Boxes, other: Boxes) -> Bool[np.ndarray, "*s"]:
    """Separating axis test of boxes; shapes are broadcast."""
    offset = other.position_m - one.position_m
    return turned_boxes_touch(
        offset[..., 0] + 1j * offset[..., 1],
        np.exp(1j * one.heading_rad),
        np.exp(1j * other.heading_rad),
        one.size_m,
        other.size_m,
    )


def turned_boxes_touch(
    offset_m: Complex[np.ndarray, "*s"],
    direction_a: Complex[np.ndarray, "*#s"],
    direction_b: Complex[np.ndarray, "*#s"],
    size_a_m: Float[np.ndarray, "*#s 2"],
    size_b_m: Float[np.ndarray, "*#s 2"],
) -> Bool[np.ndarray, "*s"]:
    """``boxes_touch`` for vectors as complex numbers; directions are unit vectors."""
    turn = direction_b * direction_a.conj()
    cos, sin = np.abs(np.real(turn)), np.abs(np.imag(turn))
    touch = np.ones(offset_m.shape, bool)
    for direction, own, other in (
        (direction_a, size_a_m, size_b_m),
        (direction_b, size_b_m, size_a_m),
    ):
        place = offset_m * direction.conj()
        length, width = other[..., 0], other[..., 1]
        along = own[..., 0] + length * cos + width * sin
        aside = own[..., 1] + length * sin + width * cos
        touch &= np.abs(np.real(place)) * 2 < along
        touch &= np.abs(np.imag(place)) * 2 < aside
    return touch


@dataclass(frozen=True, kw_only=True)
class PathCollision:
    """First collision on a trajectory."""

    agent_id: str
    step: int


def first_collisions(
    scenario: Scenario,
    row: int,
    position_m: Float[np.ndarray, "C H 2"],
    heading_rad: Float[np.ndarray, "C H"],
    is_valid: Bool[np.ndarray, "C"],
) -> tuple[PathCollision | None, ...]:
    """Find the first collision of an agent on each of C trajectories.

    Trajectories begin at the current step; other agents move as in the scenario. Agents
    that the box overlaps at the start are left out.
    """
    agents, now = scenario.agents, scenario.current_step
    num_paths, num_points = position_m.shape[:2]
    steps = slice(now, now + num_points)
    there = agents.is_valid[:, steps].copy()
    there[row] = False
    hit = boxes_collide(
        Boxes(
            position_m=position_m[:, None],
            heading_rad=heading_rad[:, None],
            size_m=agents.size_m[row],
        ),
        agents.at_steps(steps).boxes,
        there & is_valid[:, None, None],
    )
    path, other, at = np.nonzero(hit)
    at_start = np.zeros((num_paths, len(agents)), bool)
    at_start[path[at == 0], other[at == 0]] = True
    found: list[PathCollision | None] = [None] * num_paths
    for index in np.argsort(at, kind="stable"):
        one = path[index]
        if found[one] is None and not at_start[one, other[index]]:
            found[one] = PathCollision(
                agent_id=agents.ids[other[index]], step=int(now + at[index])
            )
    return tuple(found)


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
