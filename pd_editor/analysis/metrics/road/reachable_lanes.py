"""Lanes that agents can reach by driving from their positions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES, nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import (
    CYCLIST_LANES,
    MAX_TURN_RAD,
    ON_LANE_M,
)
from pd_editor.scene.road_map import RoadMap, once_per_map

NEAR_LANE_M: Final = 8.0
"""Agents without an initial lane get the nearest such lane within this distance."""
SPARE_M: Final = 10.0
"""Lanes that begin up to this distance past the end of an agent's path count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneDistances:
    """Driving distances between the lanes of a graph."""

    graph: LaneGraph

    @cached_property
    def start_to_start_m(self) -> Float[np.ndarray, "L L"]:
        """Driving distance between the starts of two lanes; infinite if unreachable.

        A change to a neighbouring lane in the same direction costs nothing.
        """
        graph, count = self.graph, len(self.graph.lane_ids)
        distance = np.full((count, count), np.inf)
        np.fill_diagonal(distance, 0.0)
        chord = np.array([line[-1] - line[0] for line in graph.centerlines_m])
        for row in range(count):
            for other in graph.successors[row]:
                distance[row, other] = min(distance[row, other], graph.lengths_m[row])
            for other in graph.neighbors[row]:
                if chord[row] @ chord[other] > 0:
                    distance[row, other] = 0.0
        for middle in range(count):
            # Few lanes lead to one.
            starts = np.isfinite(distance[:, middle]).nonzero()[0]
            by_way = distance[starts, middle, None] + distance[middle]
            distance[starts] = np.minimum(distance[starts], by_way)
        return distance


@once_per_map
def lane_distances(road_map: RoadMap) -> LaneDistances:
    """Driving distances of a map."""
    return LaneDistances(graph=lane_graph(road_map))


def reachable_lanes(
    road_map: RoadMap,
    position_m: Float[np.ndarray, "A 2"],
    heading_rad: Float[np.ndarray, "A"],
    kinds: tuple[AgentKind, ...],
    reach_m: Float[np.ndarray, "A"],
    *,
    spare_m: float = SPARE_M,
) -> Bool[np.ndarray, "A L"]:
    """Lanes that each agent can reach within a distance, including its initial lanes.

    Initial lanes are those within 3 m and 60 degrees of the agent; without one, the
    nearest such lane within 8 m, else the nearest lane. Cyclists may use bike lanes.
    Columns are rows of the lane graph.
    """
    distances = lane_distances(road_map)
    graph, count = distances.graph, len(position_m)
    if not graph.lane_ids or not count:
        return np.zeros((count, len(graph.lane_ids)), bool)
    usable = usable_lanes(graph, kinds)
    agent, lane, along = _lanes_ahead(graph, position_m, heading_rad, usable, ON_LANE_M)
    lost = np.setdiff1d(np.arange(count), agent)
    if len(lost):
        others = _lanes_of_lost(
            road_map, position_m[lost], heading_rad[lost], usable[lost]
        )
        agent = np.concatenate([agent, lost])
        lane = np.concatenate([lane, others[0]])
        along = np.concatenate([along, others[1]])
    start_m = np.full((count, len(graph.lane_ids)), np.inf)
    ahead = distances.start_to_start_m[lane] - along[:, None]
    np.minimum.at(start_m, agent, ahead)
    start_m[agent, lane] = -np.inf
    return usable & (start_m <= reach_m[:, None] + spare_m)


def usable_lanes(
    graph: LaneGraph, kinds: tuple[AgentKind, ...]
) -> Bool[np.ndarray, "A L"]:
    """Lanes that agents may use by their kind; bike lanes are for cyclists only."""
    driving, cycling = graph.allowed(DRIVING_LANES), graph.allowed(CYCLIST_LANES)
    cycles = np.array([kind is AgentKind.CYCLIST for kind in kinds], bool)
    return np.where(cycles[:, None], cycling, driving)


def _lanes_ahead(
    graph: LaneGraph,
    position_m: Float[np.ndarray, "A 2"],
    heading_rad: Float[np.ndarray, "A"],
    usable: Bool[np.ndarray, "A L"],
    within_m: float,
) -> tuple[Int[np.ndarray, "Q"], Int[np.ndarray, "Q"], Float[np.ndarray, "Q"]]:
    """Agents, nearby lanes in their direction, and their arc lengths on these.

    Sorted by agent, then by distance.
    """
    near = graph.search.in_reach(position_m, heading_rad, usable, within_m)
    good = near.is_beside & (np.abs(near.turn_rad) <= MAX_TURN_RAD)
    return near.point[good], near.lane[good], near.along_m[good]


def _lanes_of_lost(
    road_map: RoadMap,
    position_m: Float[np.ndarray, "N 2"],
    heading_rad: Float[np.ndarray, "N"],
    usable: Bool[np.ndarray, "N L"],
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Lane, and arc length on it, of each agent without an initial lane."""
    graph = lane_graph(road_map)
    match = nearest_lanes(road_map, position_m, heading_rad=heading_rad)
    lane = np.array([graph.row_of.get(i, 0) for i in match.lane_id.tolist()], int)
    along = match.along_m.copy()
    agent, ahead, where = _lanes_ahead(
        graph, position_m, heading_rad, usable, NEAR_LANE_M
    )
    first = np.flatnonzero(np.diff(agent, prepend=-1))
    lane[agent[first]], along[agent[first]] = ahead[first], where[first]
    return lane, along
