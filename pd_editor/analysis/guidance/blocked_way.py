"""Whether agents that stand block an agent's way to its goal."""

from collections.abc import Collection
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.agent_now import AgentNow
from pd_editor.analysis.metrics.collisions.box_tests import boxes_touch
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.thresholds import STANDING_MPS

_SWERVE_M: Final = 1.0
"""Agents can swerve by so much around one that stands at the side of their way."""
_LEAST_WIDTH_M: Final = 0.2


def blocking_rows(
    agent: AgentNow,
    paths_m: Float[np.ndarray, "P M 2"],
    goal_m: Float[np.ndarray, "2"],
    along_m: Float[np.ndarray, "P"],
    leaving: Collection[str] = (),
) -> list[int]:
    """The first agent that stands on each path to a goal; none if a path is free.

    Args:
        agent: the agent that drives.
        paths_m: the paths that lead to the goal, one point every ``SPACING_M``.
        goal_m: the goal.
        along_m: its arc length on each path.
        leaving: agents that are asked to drive elsewhere, which block nothing.
    """
    agents, now = agent.scenario.agents, agent.scenario.current_step
    stands = agents.speed_mps()[:, now] < STANDING_MPS
    stands &= agents.is_valid[:, now] & agents.kind_mask(LANE_FOLLOWER_KINDS)
    stands &= ~np.isin(agents.ids, list(leaving))
    stands[agent.row] = False
    others = np.flatnonzero(stands)
    boxes = Boxes(
        position_m=agents.position_m[others, now],
        heading_rad=agents.heading_rad[others, now],
        size_m=agents.size_m[others],
    )
    length, width = agents.size_m[agent.row]
    size = np.array([length, max(width - 2 * _SWERVE_M, _LEAST_WIDTH_M)])
    found: list[int] = []
    for path, along in zip(paths_m, along_m, strict=True):
        count = max(min(int(along / SPACING_M) + 1, len(path)), 2)
        step = np.gradient(path, axis=0)[:count]
        heading = np.arctan2(step[:, 1], step[:, 0])
        heading[0] = agent.heading_rad
        share = np.arange(count) / (count - 1)
        left = left_of(unit_vector(heading))
        aside = ((goal_m - path[count - 1]) * left[-1]).sum() * share**2
        driven = Boxes(
            position_m=(path[:count] + aside[:, None] * left)[:, None],
            heading_rad=heading[:, None],
            size_m=size,
        )
        touches = boxes_touch(driven, boxes)
        # Agents that overlap now may part.
        touches &= ~touches[0]
        if not touches.any():
            return []
        found.append(int(others[touches[touches.any(axis=1).argmax()].argmax()]))
    return list(dict.fromkeys(found))
