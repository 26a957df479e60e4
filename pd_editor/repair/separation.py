"""Separates overlapping agents by sliding them along their lanes."""

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.geometry.angles import wrap_angle
from pd_editor.metrics.collisions.box_tests import overlapping_pairs
from pd_editor.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.paths.lanes.route_choice import MAX_TURN_RAD
from pd_editor.repair.box_overlaps import counted
from pd_editor.repair.current_states import States
from pd_editor.repair.repair_report import (
    RepairChange,
    RepairProblem,
    RepairReport,
    name_of,
    repairable,
    sentence,
)
from pd_editor.repair.sliding import SLIDE_REACH_M, lanes_of, slid_poses, slides_m
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
) -> tuple[Scenario, RepairReport]:
    """Slide lane followers that overlap others now to the nearest free position.

    They slide along their lane, or straight without one, by multiples of 0.25 m up to
    20 m, never further off their lane nor off the road; whole tracks move with them. Of
    a pair, the less important agent moves (benchmark category, then the later row), the
    other one only if the first cannot. Pairs that still overlap are reported.
    ``agent_ids`` None means all; ``keep_ids`` None keeps the focal agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    may_move = repairable(scenario, agent_ids, keep_ids)
    states, graph = States.of(scenario), lane_graph(scenario.road_map)
    pairs = _pairs(scenario)
    while len(pairs):
        moved = _one_pass(states, graph, pairs, may_move)
        if not moved:
            break
        pairs = _pairs(states.carried())
    return states.carried(), RepairReport(
        changes=_changes(states), problems=_problems(states, pairs, may_move)
    )


def _pairs(scenario: Scenario) -> Int[np.ndarray, "P 2"]:
    pairs = overlapping_pairs(scenario.agents, scenario.current_step)
    return pairs[counted(scenario.agents, pairs)]


def _one_pass(
    states: States,
    graph: LaneGraph,
    pairs: Int[np.ndarray, "P 2"],
    may_move: Bool[np.ndarray, "A"],
) -> set[int]:
    """Move one agent of each pair if possible; each move separates its pair."""
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
            if may_move[row] and _slide(states, graph, row, lane_of[row]):
                moved.add(row)
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


def _changes(states: States) -> tuple[RepairChange, ...]:
    agents, step = states.scenario.agents, states.scenario.current_step
    offset = states.position_m - agents.position_m[:, step]
    shift = np.hypot(offset[:, 0], offset[:, 1]) * states.exists
    turn = np.degrees(wrap_angle(states.heading_rad - agents.heading_rad[:, step]))
    return tuple(
        RepairChange(
            repair="separate-overlaps",
            agent_id=agents.ids[row],
            shift_m=float(shift[row]),
            turn_deg=float(turn[row]),
            slowdown_mps=0.0,
            message=sentence(
                f"{name_of(agents, row)} was slid {shift[row]:.1f} m to a free place"
            ),
        )
        for row in np.flatnonzero(shift > 0).tolist()
    )


def _problems(
    states: States, pairs: Int[np.ndarray, "P 2"], may_move: Bool[np.ndarray, "A"]
) -> tuple[RepairProblem, ...]:
    agents = states.scenario.agents
    return tuple(
        RepairProblem(
            repair="separate-overlaps",
            agent_ids=(agents.ids[one], agents.ids[two]),
            message=sentence(
                f"{name_of(agents, one)} and {name_of(agents, two)} overlap, and "
                f"there is no free place within {SLIDE_REACH_M:g} m for either"
            ),
        )
        for one, two in pairs.tolist()
        if may_move[one] or may_move[two]
    )
