"""Box overlaps that repairs resolve."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Int

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
