"""Agents and lanes: the paper's 4 m rule and its corrections, and deviation from reachable lanes."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.road import (
    is_off_road,
    map_points,
    nearest_points,
    paths_within,
)
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import (
    MetricValues,
    any_step,
    by_name,
    mean_over_steps,
    measured,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES, nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import (
    CYCLIST_LANES,
    MAX_TURN_RAD,
    ON_LANE_M,
)
from pd_editor.scene.road_map import RoadMap, once_per_map
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

SPARE_M: Final = 10.0
"""Lanes that begin up to this distance past the end of an agent's path count."""


@once_per_map
def start_to_start_m(road_map: RoadMap) -> Float[np.ndarray, "L L"]:
    """Driving distance between the starts of two lanes; infinite if unreachable.

    A change to a neighbouring lane in the same direction costs nothing.
    """
    graph = lane_graph(road_map)
    count = len(graph.lane_ids)
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
    graph, count = lane_graph(road_map), len(position_m)
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
    ahead = start_to_start_m(road_map)[lane] - along[:, None]
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
    # Agents without an initial lane get the nearest such lane within this distance.
    agent, ahead, where = _lanes_ahead(graph, position_m, heading_rad, usable, 8.0)
    first = np.flatnonzero(np.diff(agent, prepend=-1))
    lane[agent[first]], along[agent[first]] = ahead[first], where[first]
    return lane, along


OFF_LANE_M: Final = 4.0
BEYOND_ROADS_M: Final = 20.0
"""Agents further from all lanes drive on roads that are not mapped: 13 % of the vehicles
of ``val``, 9 % of ``train``."""


def ids_near_lanes(scenario: Scenario, ids: Sequence[str]) -> tuple[str, ...]:
    """Ids of those agents that are within ``BEYOND_ROADS_M`` of a lane's centre line now.

    Agents that are absent now count as near.
    """
    agents, step = scenario.agents, scenario.current_step
    rows = agents.rows(tuple(ids))
    is_near = ~agents.is_valid[rows, step]
    center = map_points(scenario.road_map).center_m
    if len(center) and len(rows):
        _, distance = nearest_points(agents.position_m[rows, step], center)
        is_near |= distance <= BEYOND_ROADS_M
    return tuple(name for name, near in zip(ids, is_near, strict=True) if near)


def off_lane_values(view: TrafficView) -> dict[str, MetricValues]:
    """Off-road metrics of the evaluated agents that follow lanes by name, each [A]."""
    valid = evaluated_steps(view)
    position = view.agents.position_m
    center = map_points(view.scenario.road_map).center_m
    outside = np.zeros(valid.shape, bool)
    outside[valid] = is_off_road(view.scenario, position[valid])
    far = valid & ~paths_within(position, valid, center, OFF_LANE_M)
    whole, exists = np.all(far | ~valid, axis=1), np.any(valid, axis=1)
    return by_name(
        measured("init_off_road_4m", far[:, 0], valid[:, 0]),
        measured("off_road_4m_whole_path", whole, exists),
        any_step("off_road_4m", far, valid),
        mean_over_steps("off_road_4m_steps", far, valid),
        measured("init_off_drivable", outside[:, 0], valid[:, 0]),
        any_step("off_drivable", outside, valid),
        mean_over_steps("off_drivable_steps", outside, valid),
    )


def nearest_edge(view: TrafficView) -> tuple[MetricValues, MetricValues]:
    """Metrics ``nearest_edge`` and ``nearest_edge_angle`` at the current step [A]."""
    is_valid, agents = evaluated_steps(view)[:, 0], view.agents
    points = map_points(view.scenario.road_map)
    distance, angle = np.zeros(len(view)), np.zeros(len(view))
    if len(points.center_m):
        nearest, distance = nearest_points(agents.position_m[:, 0], points.center_m)
        turn = wrap_angle(agents.heading_rad[:, 0] - points.heading_rad[nearest])
        angle = np.degrees(turn)
    is_valid = is_valid & (len(points.center_m) > 0)
    return (
        measured("nearest_edge", distance, is_valid),
        measured("nearest_edge_angle", angle, is_valid),
    )


def evaluated_steps(view: TrafficView) -> Bool[np.ndarray, "A H"]:
    """Steps at which evaluated agents that follow lanes exist."""
    follows = [kind in LANE_FOLLOWER_KINDS for kind in view.agents.kinds]
    return view.agents.is_valid & np.array(follows, bool)[:, None]


WRONG_WAY_M: Final = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneDeviation:
    """Deviation of A evaluated agents at H steps from their reachable lanes."""

    is_valid: Bool[np.ndarray, "A H"]
    """False for pedestrians, and if the map has no lane for the agent."""
    lateral_m: Float[np.ndarray, "A H"]
    """Distance to the nearest reachable lane."""
    angle_deg: Float[np.ndarray, "A H"]
    """Angle between the heading and that lane, 0 to 180."""
    is_wrong_way: Bool[np.ndarray, "A H"]
    can_be_wrong_way: Bool[np.ndarray, "A H"]
    """Whether the agent moves within 2 m of the centre line of a lane."""
    lane: Int[np.ndarray, "A H"]
    """Row in the lane graph of the nearest reachable lane."""

    def values(self) -> dict[str, MetricValues]:
        """Lane metrics by name, each [A]; the current step does not count."""
        later = self.is_valid[:, 1:]
        last = later.shape[1] - later[:, ::-1].argmax(axis=1) if later.size else 0
        final = self.lateral_m[np.arange(len(later)), last]
        return by_name(
            mean_over_steps("lateral_deviation_mean", self.lateral_m[:, 1:], later),
            measured("lateral_deviation_final", final, np.any(later, axis=1)),
            mean_over_steps("angular_deviation_mean", self.angle_deg[:, 1:], later),
            mean_over_steps(
                "wrong_way", self.is_wrong_way[:, 1:], self.can_be_wrong_way[:, 1:]
            ),
        )


@lru_cache(maxsize=2)
def lane_deviation(view: TrafficView) -> LaneDeviation:
    """Deviation from the lanes that are reachable within each agent's path length.

    Findings and scorecard ask for the same; that of the newest views is kept.
    """
    agents, road_map = view.agents, view.scenario.road_map
    graph = lane_graph(road_map)
    is_valid = evaluated_steps(view)
    reachable = reachable_lanes(
        road_map,
        agents.position_m[:, 0],
        agents.heading_rad[:, 0],
        agents.kinds,
        path_length_m(agents.position_m, agents.is_valid),
    )
    is_valid = is_valid & is_valid[:, :1] & np.any(reachable, axis=1)[:, None]
    search = graph.extended_search
    lateral, segment = search.nearest_on_paths(agents.position_m, is_valid, reachable)
    angle, lane = np.zeros(is_valid.shape), np.zeros(is_valid.shape, int)
    if len(search.lane):
        cosine = (unit_vector(agents.heading_rad) * search.direction[segment]).sum(-1)
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        lane = search.lane[segment]
    speed = np.hypot(agents.velocity_mps[..., 0], agents.velocity_mps[..., 1])
    on_lane, with_lane = search.is_near_paths(
        agents.position_m,
        agents.heading_rad,
        evaluated_steps(view) & (speed > MOVING_MPS),
        usable_lanes(graph, agents.kinds),
        WRONG_WAY_M,
    )
    return LaneDeviation(
        is_valid=is_valid,
        lateral_m=lateral,
        angle_deg=angle,
        is_wrong_way=on_lane & ~with_lane,
        can_be_wrong_way=on_lane,
        lane=lane,
    )


def path_length_m(
    position_m: Float[np.ndarray, "A H 2"], is_valid: Bool[np.ndarray, "A H"]
) -> Float[np.ndarray, "A"]:
    """Length of each path over pairs of consecutive valid steps."""
    step = np.diff(position_m, axis=1)
    both = is_valid[:, 1:] & is_valid[:, :-1]
    return np.where(both, np.hypot(step[..., 0], step[..., 1]), 0.0).sum(axis=1)
