"""Separates overlapping agents by sliding them along their lanes."""

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.analysis.metrics.collisions.box_tests import overlapping_pairs
from pd_editor.analysis.repair.current_states import (
    SLIDE_REACH_M,
    States,
    lanes_of,
    slid_poses,
    slides_m,
)
from pd_editor.analysis.repair.repairable import counted, repairable
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.paths.lanes.route_choice import MAX_TURN_RAD
from pd_editor.scene.scenario import Scenario

GAP_M: Final = 0.5
"""Gap ahead of and behind an agent that was slid."""
_LANE_REACH_M: Final = 6.0
"""Agents within this distance of a lane, including parked ones, slide along it."""


def separate_overlaps(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
) -> Scenario:
    """Slide lane followers that overlap others now to the nearest free position.

    They slide along their lane, or straight without one, by multiples of 0.25 m up to
    20 m, never further off their lane nor off the road; whole tracks move with them. Of
    a pair, the less important agent moves (benchmark category, then the later row), the
    other one only if the first cannot.
    ``agent_ids`` None means all; ``keep_ids`` None keeps the focal agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    may_move = repairable(scenario, agent_ids, keep_ids)
    states, graph = States.of(scenario), lane_graph(scenario.road_map)
    pairs, stuck = _pairs(scenario), np.zeros(len(may_move), bool)
    while len(pairs):
        if not _one_pass(states, graph, pairs, may_move, stuck):
            break
        pairs = _pairs(states.carried())
    return states.carried()


def _pairs(scenario: Scenario) -> Int[np.ndarray, "P 2"]:
    pairs = overlapping_pairs(scenario.agents, scenario.current_step)
    return pairs[counted(scenario.agents, pairs)]


def _one_pass(
    states: States,
    graph: LaneGraph,
    pairs: Int[np.ndarray, "P 2"],
    may_move: Bool[np.ndarray, "A"],
    stuck: Bool[np.ndarray, "A"],
) -> set[int]:
    """Move one agent of each pair if possible; each move separates its pair.

    Agents that find no place are ``stuck`` until one moves away in their reach.
    """
    agents = states.scenario.agents
    rows = np.unique(pairs[may_move[pairs]])
    choice = lanes_of(
        graph,
        states.position_m[rows],
        states.heading_rad[rows],
        tuple(agents.kinds[row] for row in rows),
        reach_m=_LANE_REACH_M,
        max_turn_rad=MAX_TURN_RAD,
    )
    lane_of = dict(zip(rows.tolist(), choice.lane.tolist(), strict=True))
    moved: set[int] = set()
    for pair in pairs.tolist():
        if moved & set(pair):
            continue
        for row in sorted(pair, key=lambda one: (agents.categories[one], -one)):
            if not may_move[row] or stuck[row]:
                continue
            before = states.position_m[row].copy()
            stuck[row] = not _slide(states, graph, row, lane_of[row])
            if not stuck[row]:
                moved.add(row)
                apart = np.hypot(*(states.position_m - before).T)
                # Beside a bend an agent goes further than along its lane.
                stuck &= apart > 2 * SLIDE_REACH_M + agents.radius_m.max()
                break
    return moved


def _slide(states: States, graph: LaneGraph, row: int, lane: int) -> bool:
    """Move an agent to the nearest free position; False if there is none."""
    position, heading = slid_poses(
        graph, lane, states.position_m[row], float(states.heading_rad[row]), slides_m()
    )
    best = states.first_free(row, position, heading, gap_m=GAP_M)
    if best is None:
        return False
    states.position_m[row], states.heading_rad[row] = position[best], heading[best]
    return True
