"""Collisions of an agent on candidate trajectories."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.collisions.box_tests import boxes_collide
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.scenario import Scenario


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
