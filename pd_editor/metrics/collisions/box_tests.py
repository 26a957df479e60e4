"""Box overlap tests between agents over time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from pd_editor.geometry.oriented_box import box_corners, overlap_area
from pd_editor.metrics.road.path_pieces import bounds_m, rectangles_meet
from pd_editor.scene.agent_tracks import AgentTracks

MIN_OVERLAP_M2: Final = 0.05
"""Boxes that share at most this area only touch."""
_PORTION: Final = 50_000
"""Number of pairs times steps per chunk."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """N oriented boxes: centres, headings, and sizes (length, width)."""

    position_m: Float[np.ndarray, "N 2"]
    heading_rad: Float[np.ndarray, "N"]
    size_m: Float[np.ndarray, "N 2"]

    def __getitem__(self, index: Bool[np.ndarray, "N"]) -> "Boxes":
        """Some of the boxes."""
        return Boxes(
            position_m=self.position_m[index],
            heading_rad=self.heading_rad[index],
            size_m=self.size_m[index],
        )

    def corners(self) -> Float[np.ndarray, "N 4 2"]:
        """Corners, counter-clockwise from front left."""
        return box_corners(self.position_m, self.heading_rad, self.size_m)


def boxes_collide(one: Boxes, other: Boxes) -> Bool[np.ndarray, "N"]:
    """Whether each box shares more than ``MIN_OVERLAP_M2`` with its counterpart."""
    offset = other.position_m - one.position_m
    reach = np.hypot(*one.size_m.T) + np.hypot(*other.size_m.T)
    found = np.einsum("nd,nd->n", offset, offset) < (reach / 2) ** 2
    near, one, other = offset[found], one[found], other[found]
    touch = boxes_touch(
        near, one.heading_rad, other.heading_rad, one.size_m, other.size_m
    )
    found[found] = touch
    area = overlap_area(one[touch].corners(), other[touch].corners())
    found[found] = area > MIN_OVERLAP_M2
    return found


def overlapping_pairs(agents: AgentTracks, step: int) -> Int[np.ndarray, "P 2"]:
    """Pairs of rows, the lower one first, whose boxes overlap at a step."""
    pairs, _ = first_overlap(agents, np.array([step]))
    return pairs


def first_overlap(
    agents: AgentTracks, steps: Int[np.ndarray, "S"]
) -> tuple[Int[np.ndarray, "P 2"], Int[np.ndarray, "P"]]:
    """Pairs of rows that overlap at any of the steps, and the first such step.

    ``steps`` must increase. Pairs are sorted by row, the lower one first.
    """
    position, is_valid = agents.position_m[:, steps], agents.is_valid[:, steps]
    radius = np.hypot(agents.size_m[:, 0], agents.size_m[:, 1]) / 2
    pairs = pairs_that_meet(position, is_valid, radius)
    heading, first = agents.heading_rad[:, steps], np.full(len(pairs), -1)
    for part, some in _parts(len(pairs), position.shape[1]):
        # Pairs that were found to overlap are not tested again.
        open_pairs = part[first[part] < 0]
        pair, at = overlaps_of_pairs(
            pairs[open_pairs],
            position[:, some],
            heading[:, some],
            is_valid[:, some],
            agents.size_m,
        )
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
    pairs: Int[np.ndarray, "P 2"],
    position_m: Float[np.ndarray, "A S 2"],
    heading_rad: Float[np.ndarray, "A S"],
    is_valid: Bool[np.ndarray, "A S"],
    size_m: Float[np.ndarray, "A 2"],
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Indices of overlapping pairs and steps, sorted by pair, then by step."""
    a, b = pairs.T
    offset = position_m[b] - position_m[a]
    radius = np.hypot(size_m[:, 0], size_m[:, 1]) / 2
    reach = (radius[a] + radius[b])[:, None]
    near = np.einsum("psd,psd->ps", offset, offset) < reach**2
    near &= is_valid[a] & is_valid[b]
    pair, at = np.nonzero(near)
    one, other = (
        Boxes(
            position_m=position_m[rows, at],
            heading_rad=heading_rad[rows, at],
            size_m=size_m[rows],
        )
        for rows in (a[pair], b[pair])
    )
    collide = boxes_collide(one, other)
    return pair[collide], at[collide]


def boxes_touch(
    offset_m: Float[np.ndarray, "N 2"],
    heading_a_rad: Float[np.ndarray, "N"],
    heading_b_rad: Float[np.ndarray, "N"],
    size_a_m: Float[np.ndarray, "N 2"],
    size_b_m: Float[np.ndarray, "N 2"],
) -> Bool[np.ndarray, "N"]:
    """Separating axis test on centres, headings and sizes."""
    return turned_boxes_touch(
        offset_m[:, 0] + 1j * offset_m[:, 1],
        np.exp(1j * heading_a_rad),
        np.exp(1j * heading_b_rad),
        size_a_m,
        size_b_m,
    )


def turned_boxes_touch(
    offset_m: Complex[np.ndarray, "N"],
    direction_a: Complex[np.ndarray, "N"],
    direction_b: Complex[np.ndarray, "N"],
    size_a_m: Float[np.ndarray, "N 2"],
    size_b_m: Float[np.ndarray, "N 2"],
) -> Bool[np.ndarray, "N"]:
    """``boxes_touch`` for vectors as complex numbers; directions are unit vectors."""
    turn = direction_b * direction_a.conj()
    cos, sin = np.abs(np.real(turn)), np.abs(np.imag(turn))
    touch = np.ones(len(turn), bool)
    for direction, own, other in (
        (direction_a, size_a_m, size_b_m),
        (direction_b, size_b_m, size_a_m),
    ):
        place = offset_m * direction.conj()
        length, width = other.T
        along = own[:, 0] + length * cos + width * sin
        aside = own[:, 1] + length * sin + width * cos
        touch &= np.abs(np.real(place)) * 2 < along
        touch &= np.abs(np.imag(place)) * 2 < aside
    return touch
