"""Box overlaps that repairs resolve."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.metrics.collisions.box_tests import Boxes, boxes_collide
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks

_PUSHED_WITH: Final = frozenset({AgentKind.PEDESTRIAN, AgentKind.RIDERLESS_BICYCLE})
"""Kinds that cyclists overlap in recordings, when they get on or off."""


def counted(
    agents: AgentTracks, pairs: Int[np.ndarray, "P 2"]
) -> Bool[np.ndarray, "P"]:
    """Whether pairs are to be separated: pairs with at least one lane follower.

    Pairs of a cyclist and a pedestrian or riderless bicycle are left out.
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
    """Whether one box, at each of K poses, overlaps each of A others."""
    gap = position_m[:, None] - other_position_m
    reach = (np.hypot(*size_m) + np.hypot(*other_size_m.T)) / 2
    pose, other = np.nonzero((gap**2).sum(-1) < reach**2)
    found = np.zeros(gap.shape[:2], bool)
    found[pose, other] = boxes_collide(
        Boxes(
            position_m=position_m[pose],
            heading_rad=heading_rad[pose],
            size_m=np.broadcast_to(size_m, (len(pose), 2)),
        ),
        Boxes(
            position_m=other_position_m[other],
            heading_rad=other_heading_rad[other],
            size_m=other_size_m[other],
        ),
    )
    return found
