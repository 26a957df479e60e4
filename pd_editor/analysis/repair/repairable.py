"""Agents that a repair may change, and the box overlaps that it resolves."""

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

_PUSHED_WITH: Final = frozenset({AgentKind.PEDESTRIAN, AgentKind.RIDERLESS_BICYCLE})
"""Kinds that cyclists overlap in recordings, when they get on or off."""


def repairable(
    scenario: Scenario,
    agent_ids: Iterable[str] | None,
    keep_ids: Collection[str] | None,
    kinds: Collection[AgentKind] = LANE_FOLLOWER_KINDS,
    *,
    keeps_beginnings: bool = False,
) -> Bool[np.ndarray, "A"]:
    """Which agents may be repaired: present ones of ``kinds`` in ``agent_ids`` (None: all).

    Agents in ``keep_ids`` are left out; None means the focal agent. Locked agents are
    left out as well; if the repair keeps the beginnings of trajectories, only those with a
    locked trajectory.

    Raises:
        EditError: an id is not in the scenario.
    """
    agents = scenario.agents
    asked = np.zeros(len(agents), bool)
    asked[agents.rows(agents.ids if agent_ids is None else agent_ids)] = True
    if keep_ids is None:
        keep_ids = {scenario.focal_id} & set(agents.ids)
    asked[agents.rows(keep_ids)] = False
    asked[
        agents.rows(
            name
            for name, lock in scenario.locks.items()
            if lock.keeps_trajectory or not keeps_beginnings
        )
    ] = False
    return asked & agents.kind_mask(kinds) & agents.is_valid[:, scenario.current_step]


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
