"""Snaps moving agents beside the road to their lanes."""

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np

from pd_editor.analysis.repair.current_states import (
    States,
    lanes_of,
    line_through,
    poses_along,
    slides_m,
)
from pd_editor.analysis.repair.repairable import repairable
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.paths.lanes.route_choice import MAX_TURN_RAD
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

MAX_OFFSET_M: Final = 2.0
"""A moving agent within this distance of a centre line is on its lane.

Half of a wide lane: an agent that changes lanes is never further from both.
"""
MAX_SHIFT_M: Final = 15.0
"""Lanes further away than this are not considered."""


def project_to_lanes(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
    max_offset_m: float = MAX_OFFSET_M,
    moves_stationary: bool = False,
) -> Scenario:
    """Snap moving lane followers that are too far from any lane in their direction.

    They keep their speed and head along the lane; whole tracks move with them.
    Stationary agents stay, since parked ones belong beside lanes, unless
    ``moves_stationary`` is set. If the position on the lane is occupied, the nearest
    free one along it is used. Agents that would overlap more others than before stay.
    ``agent_ids`` None means all; ``keep_ids`` None keeps the focal agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    agents, step = scenario.agents, scenario.current_step
    is_meant = repairable(scenario, agent_ids, keep_ids)
    if not moves_stationary:
        is_meant &= agents.speed_mps()[:, step] >= MOVING_MPS
    rows = np.flatnonzero(is_meant)
    states, graph = States.of(scenario), lane_graph(scenario.road_map)
    choice = lanes_of(
        graph,
        states.position_m[rows],
        states.heading_rad[rows],
        tuple(agents.kinds[row] for row in rows),
        reach_m=MAX_SHIFT_M,
        max_turn_rad=MAX_TURN_RAD,
    )
    off_lane = np.flatnonzero(choice.distance_m > max_offset_m).tolist()
    _place_until_stuck(
        states,
        graph,
        {int(rows[i]): (int(choice.lane[i]), choice.along_m[i]) for i in off_lane},
    )
    return states.carried()


def _place_until_stuck(
    states: States, graph: LaneGraph, place_of: dict[int, tuple[int, float]]
) -> None:
    """Move each row to its lane if possible."""
    left = list(place_of)
    num_left = len(left) + 1
    # A position may become free when another agent is moved.
    while len(left) < num_left:
        num_left = len(left)
        left = [
            row for row in left if not _put_on_lane(states, row, graph, *place_of[row])
        ]


def _put_on_lane(
    states: States, row: int, graph: LaneGraph, lane: int, along_m: float
) -> bool:
    """Move an agent to the nearest free position on its lane; False if there is none."""
    if lane < 0:
        return False
    on_lane = float(np.clip(along_m, 0.0, graph.lengths_m[lane]))
    frames, start = line_through(graph, lane)
    here = start + on_lane
    position, heading, _ = poses_along(frames, np.array([here]), 0.0)
    now = states.position_m[row][None], states.heading_rad[row][None]
    num_before, num_there = states.num_overlaps(
        row, np.concatenate([now[0], position]), np.append(now[1], heading)
    ).tolist()
    best: int | None = 0
    if num_there > num_before or not states.is_no_worse(row, position)[0]:
        position, heading, is_there = poses_along(frames, here + slides_m(), 0.0)
        position, heading = position[is_there], heading[is_there]
        best = states.first_free(row, position, heading, max_overlaps=num_before)
    if best is None:
        return False
    states.position_m[row] = position[best]
    states.heading_rad[row] = wrap_angle(heading)[best]
    return True
