"""Problems of agents whose boxes overlap.

Overlaps that are frequent in recordings and that no edit can resolve are left out:

- overlaps between static objects (cones, bins, signs), between pedestrians (they walk
  in groups), and between pedestrians and bicycles that they push;
- later overlaps of two stationary agents, which only come into view.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.oriented_box import BoxStates, overlap_area
from pd_editor.metrics.collisions.box_tests import overlaps_of_pairs, pairs_that_meet
from pd_editor.metrics.step_spans import spans_of
from pd_editor.problems.scene_problem import (
    SceneProblem,
    agent_name,
    at_time,
    capitalised,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

MOVING_M: Final = 0.5
"""An agent that stays within this distance is stationary."""
_PAIRS_AT_ONCE: Final = 1_000
MAX_COLLISIONS: Final = 500
"""Limit of reported collisions, which bounds time and memory."""


def collisions(scenario: Scenario, steps: Int[np.ndarray, "S"]) -> list[SceneProblem]:
    """Find pairs that overlap at any of the increasing steps from the current one on.

    A pair that overlaps now is reported once, not again for later steps.
    """
    agents, now = scenario.agents, scenario.current_step
    boxes = agents.at_steps(steps)
    pairs = pairs_that_meet(boxes.position_m, boxes.is_valid, boxes.radius_m)
    pairs = pairs[_pairs_matter(agents, pairs)]
    pair, at, area = _overlaps(boxes, pairs)
    moves = _moves(boxes.position_m, boxes.is_valid)
    appears = np.where(
        agents.is_valid[:, now], now, agents.is_valid[:, now:].argmax(axis=1) + now
    )
    found = []
    bounds = np.flatnonzero(np.diff(pair, prepend=-1, append=-1))[: MAX_COLLISIONS + 1]
    for start, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        one, two = pairs[pair[start]].tolist()
        hit = steps[at[start:end]]
        first = int(hit[0])
        is_now = first == now
        if not is_now and not (moves[one] or moves[two]):
            continue
        names = [
            agent_name(agents, row)
            + (
                ""
                if appears[row] == now
                else f" (appears {at_time(scenario, int(appears[row]))})"
            )
            for row in (one, two)
        ]
        time = "" if is_now else f" {at_time(scenario, first)}"
        middle = (agents.position_m[one, first] + agents.position_m[two, first]) / 2
        worst = start + int(area[start:end].argmax())
        found.append(
            SceneProblem(
                kind="collision" if is_now else "later-collision",
                agent_ids=(agents.ids[one], agents.ids[two]),
                spans=spans_of(hit),
                worst_step=int(steps[at[worst]]),
                severity=float(area[worst]),
                headline=f"{agents.ids[one]} and {agents.ids[two]} collide",
                message=f"{capitalised(names[0])} and {names[1]} collide{time}.",
                place_m=(float(middle[0]), float(middle[1])),
            )
        )
    return found


def _overlaps(
    boxes: BoxStates, pairs: Int[np.ndarray, "P 2"]
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Index of the pair, index of the step and shared area of each overlap.

    Sorted by pair, then by step; of very many pairs only the first ones are tested.
    """
    parts, num_found = [], 0
    for start in range(0, len(pairs), _PAIRS_AT_ONCE):
        some = pairs[start : start + _PAIRS_AT_ONCE]
        pair, at = overlaps_of_pairs(some, boxes)
        one, two = (boxes.at(rows, at).corners_m() for rows in some[pair].T)
        parts.append((pair + start, at, overlap_area(one, two)))
        num_found += len(np.unique(pair))
        if num_found >= MAX_COLLISIONS:
            break
    nothing = (np.zeros(0, int), np.zeros(0, int), np.zeros(0))
    columns = zip(nothing, *parts, strict=True)
    pair, at, area = (np.concatenate(column) for column in columns)
    return pair, at, area


def _moves(
    position_m: Float[np.ndarray, "A S 2"], is_valid: Bool[np.ndarray, "A S"]
) -> Bool[np.ndarray, "A"]:
    """Whether each agent moves during the steps."""
    first = np.take_along_axis(
        position_m, is_valid.argmax(axis=1)[:, None, None], axis=1
    )
    distance = np.linalg.norm(position_m - first, axis=-1)
    return np.any(is_valid & (distance > MOVING_M), axis=1)


def _pairs_matter(
    agents: AgentTracks, pairs: Int[np.ndarray, "P 2"]
) -> Bool[np.ndarray, "P"]:
    uses_road = agents.kind_mask(ROAD_USER_KINDS)
    walks = agents.kind_mask({AgentKind.PEDESTRIAN})
    rides = agents.kind_mask({AgentKind.CYCLIST})
    bicycle = agents.kind_mask({AgentKind.RIDERLESS_BICYCLE})
    a, b = pairs[:, 0], pairs[:, 1]
    pushes = (bicycle[a] & (walks | rides)[b]) | (bicycle[b] & (walks | rides)[a])
    return (uses_road[a] | uses_road[b]) & ~(walks[a] & walks[b]) & ~pushes
