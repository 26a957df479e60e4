"""Box overlap tests between agents over time."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from pd_editor.scene.geometry.oriented_box import Boxes, BoxStates, overlap_area
from pd_editor.scene.geometry.path_pieces import bounds_m, rectangles_meet
from pd_editor.scene.scenario import Scenario

MIN_OVERLAP_M2: Final = 0.05
"""Boxes that share at most this area only touch."""
_DISC_M: Final = 0.13
"""Radius of a disc of a larger area than that."""
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
    within = [replace(box, size_m=box.size_m - 2 * _DISC_M) for box in (one, other)]
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
