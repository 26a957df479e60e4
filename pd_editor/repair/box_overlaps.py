"""Overlaps that a repair looks at."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.oriented_box import box_corners, overlap_area
from pd_editor.metrics.collisions.box_tests import MIN_OVERLAP_M2
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks

_PUSHED_WITH: Final = frozenset({AgentKind.PEDESTRIAN, AgentKind.RIDERLESS_BICYCLE})
"""Cyclists overlap these in recordings, getting on and off."""


def counted(
    agents: AgentTracks, pairs: Int[np.ndarray, "P 2"]
) -> Bool[np.ndarray, "P"]:
    """Whether overlaps are to be mended: those of lane followers with anything.

    Left out are cyclists with pedestrians or riderless bicycles.
    """
    follows = agents.kind_mask(LANE_FOLLOWER_KINDS)[pairs]
    cycles = agents.kind_mask([AgentKind.CYCLIST])[pairs]
    pushed = agents.kind_mask(_PUSHED_WITH)[pairs]
    return np.any(follows, axis=1) & ~(np.any(cycles, axis=1) & np.any(pushed, axis=1))


def box_overlaps(
    position_m: Float[np.ndarray, "K 2"],
    heading_rad: Float[np.ndarray, "K"],
    size_m: Float[np.ndarray, "2"],
    other_position_m: Float[np.ndarray, "A 2"],
    other_heading_rad: Float[np.ndarray, "A"],
    other_size_m: Float[np.ndarray, "A 2"],
) -> Bool[np.ndarray, "K A"]:
    """Whether one box at K poses overlaps A others, by more than a touch."""
    gap = position_m[:, None] - other_position_m
    reach = (np.hypot(*size_m) + np.hypot(*other_size_m.T)) / 2
    pose, other = np.nonzero((gap**2).sum(-1) < reach**2)
    found = np.zeros(gap.shape[:2], bool)
    if len(pose) == 0:
        return found
    area = overlap_area(
        box_corners(
            position_m[pose],
            heading_rad[pose],
            np.repeat(size_m[None], len(pose), axis=0),
        ),
        box_corners(
            other_position_m[other], other_heading_rad[other], other_size_m[other]
        ),
    )
    found[pose, other] = area > MIN_OVERLAP_M2
    return found
