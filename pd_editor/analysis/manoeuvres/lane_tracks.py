"""The lane that each agent follows over time: the likeliest sequence, not the nearest lanes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.manoeuvres.limits import LIMITS
from pd_editor.analysis.manoeuvres.motion import Motion
from pd_editor.analysis.metrics.road.reachable_lanes import usable_lanes
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.road_map import RoadMap


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneTracks:
    """Lanes of A agents at S steps."""

    lane: Int[np.ndarray, "A S"]
    """Row in the lane graph; -1 where none is followed."""
    offset_m: Float[np.ndarray, "A S"]
    """Offset to the left of the lane."""
    turn_rad: Float[np.ndarray, "A S"]
    """Heading minus the lane's direction."""
    leads_to: Bool[np.ndarray, "N N"]
    """Whether a lane is another one or leads to it; the last row and column are no lane."""
    is_junction: Bool[np.ndarray, "A S"]
    """Whether the lane is one of a junction."""
    knows_junctions: bool
    """Whether the map tells lanes of junctions from others."""


def lane_tracks(road_map: RoadMap, motion: Motion) -> LaneTracks:
    """Follow lanes by place and heading; a successor is the same way, a change costs.

    So noise, short segments, forks and lanes that cross do not change lanes.
    """
    graph, agents = lane_graph(road_map), motion.agents
    shape, count = agents.is_valid.shape, len(graph.lane_ids)
    lane = np.full((*shape, LIMITS.num_candidates + 1), -1)
    offset, turn = np.zeros(lane.shape), np.zeros(lane.shape)
    cost = np.full(lane.shape, np.inf)
    cost[..., -1] = 9.0
    # Of who stays in its place the first step is enough.
    wanted = agents.is_valid & motion.is_follower[:, None]
    first = np.arange(shape[1]) == agents.is_valid.argmax(axis=1)[:, None]
    row, step = np.nonzero(wanted & (motion.has_moved[:, None] | first))
    if count and len(row):
        usable = usable_lanes(graph, agents.kinds)[row]
        place, heading = agents.position_m[row, step], agents.heading_rad[row, step]
        near = graph.search.in_reach(place, heading, usable, LIMITS.lane_reach_m)
        keep = np.abs(near.turn_rad) <= LIMITS.lane_turn_rad
        point = near.point[keep]
        rank = np.arange(len(point)) - np.searchsorted(point, point)
        good = rank < LIMITS.num_candidates
        at = row[point[good]], step[point[good]], rank[good]
        lane[at] = near.lane[keep][good]
        offset[at] = near.offset_m[keep][good]
        turn[at] = near.turn_rad[keep][good]
        # Past an end of a lane the distance counts, so that the next one is taken.
        far = near.distance_m[keep][good]
        cost[at] = np.minimum((far / 1.2) ** 2, 8.0) + (turn[at] / 0.5) ** 2
    leads_to = _leads_to(graph)
    pick = _likeliest(lane, offset, 0.2 * cost, leads_to)[..., None]
    chosen = np.take_along_axis(lane, pick, axis=-1)[..., 0]
    crossing = np.array(
        [road_map.lane_of[one].is_intersection for one in graph.lane_ids], bool
    )
    return LaneTracks(
        lane=chosen,
        offset_m=np.take_along_axis(offset, pick, axis=-1)[..., 0],
        turn_rad=np.take_along_axis(turn, pick, axis=-1)[..., 0],
        leads_to=leads_to,
        is_junction=np.append(crossing, False)[chosen],
        knows_junctions=bool(crossing.any()),
    )


def _leads_to(graph: LaneGraph) -> Bool[np.ndarray, "N N"]:
    count = len(graph.lane_ids)
    reach = np.eye(count + 1, dtype=bool)
    reach[-1, -1] = False
    for start in range(count):
        edge = {start}
        for _ in range(LIMITS.num_hops):
            edge = {after for one in edge for after in graph.successors[one]}
            reach[start, list(edge)] = True
    return reach


def _likeliest(
    lane: Int[np.ndarray, "A S K"],
    offset_m: Float[np.ndarray, "A S K"],
    cost: Float[np.ndarray, "A S K"],
    leads_to: Bool[np.ndarray, "N N"],
) -> Int[np.ndarray, "A S"]:
    """Candidates of the cheapest sequence (Viterbi's algorithm), for all agents at once."""
    num_steps = lane.shape[1]
    one, two = lane[:, :-1, :, None], lane[:, 1:, None]
    # Steps back are the noise of who hardly moves.
    change = np.where(leads_to[one, two], 0.0, np.where(leads_to[two, one], 0.3, 3.0))
    apart = np.abs(offset_m[:, :-1, :, None] - offset_m[:, 1:, None])
    change = np.where(apart < LIMITS.apart_m, np.minimum(change, 0.7), change)
    change = np.where((one < 0) | (two < 0), 1.0, change)
    change = np.where((one < 0) & (two < 0), 0.0, change)
    total, back = cost[:, 0], []
    for step in range(1, num_steps):
        every = total[:, :, None] + change[:, step - 1]
        back.append(every.argmin(axis=1))
        total = every.min(axis=1) + cost[:, step]
    pick = np.zeros(lane.shape[:2], int)
    pick[:, -1] = total.argmin(axis=1)
    for step in range(num_steps - 1, 0, -1):
        at = pick[:, step, None]
        pick[:, step - 1] = np.take_along_axis(back[step - 1], at, axis=1)[:, 0]
    return pick
