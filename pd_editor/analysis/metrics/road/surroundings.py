"""Surroundings of each vehicle, for the scene test, and standing vehicles that are askew."""

from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.road.map_points import nearest_points
from pd_editor.analysis.metrics.road.off_road import drivable_ground
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, measured
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.thresholds import STANDING_MPS
from scene_test import FEATURES, Road, Vehicles, vehicle_features
from scene_test.features import folded_deg

ASKEW_TO_LANE_DEG: Final = (15.0, 75.0)
ASKEW_TO_NEIGHBOUR_DEG: Final = 15.0


def surroundings(view: TrafficView) -> MetricValues:
    """Features of the scene test of each vehicle [A F]; not valid for other kinds."""
    present = _vehicles(view.everyone)
    evaluated = present[: len(view)]  # Evaluated agents come first.
    road = _road(view.scenario.road_map)
    values = np.zeros((len(view), len(FEATURES)))
    if evaluated.any() and road.lines_m:
        now = view.everyone.taken(present)
        found = vehicle_features(
            Vehicles(
                ids=now.ids,
                position_m=now.position_m[:, 0],
                heading_rad=now.heading_rad[:, 0],
                speed_mps=now.speed_mps()[:, 0],
            ),
            road,
        )
        values[evaluated] = found[: evaluated.sum()]
    else:
        evaluated = np.zeros(len(view), bool)
    is_valid = np.repeat(evaluated[:, None], len(FEATURES), axis=1)
    return measured("surroundings", values, is_valid)


def askew(view: TrafficView) -> tuple[MetricValues, MetricValues]:
    """Metrics of stationary vehicles at an angle to the nearest lane or neighbour."""
    agents = view.agents
    speed = np.hypot(*agents.velocity_mps[:, 0].T)
    standing = _vehicles(agents) & (speed < STANDING_MPS)
    position, heading = agents.position_m[:, 0], agents.heading_rad[:, 0]
    lane_m, turn = np.full(len(view), np.inf), np.zeros(len(view))
    lane_m[standing], turn[standing] = nearest_lane(
        view.scenario.road_map, position[standing], heading[standing]
    )
    has_lane = np.isfinite(lane_m)
    others = view.everyone
    distance = np.linalg.norm(position[:, None] - others.position_m[:, 0], axis=-1)
    distance[:, ~_vehicles(others)] = np.inf
    np.fill_diagonal(distance, np.inf)  # Evaluated agents come first among all.
    nearest = distance.argmin(axis=1) if len(others) else np.zeros(0, int)
    has_neighbour = standing & np.isfinite(distance).any(axis=1)
    apart = folded_deg(heading - others.heading_rad[nearest, 0])
    low, high = ASKEW_TO_LANE_DEG
    return (
        measured("askew_to_lane", (turn > low) & (turn < high), has_lane),
        measured("askew_to_neighbour", apart > ASKEW_TO_NEIGHBOUR_DEG, has_neighbour),
    )


def nearest_lane(
    road_map: RoadMap,
    position_m: Float[np.ndarray, "V 2"],
    heading_rad: Float[np.ndarray, "V"],
) -> tuple[Float[np.ndarray, "V"], Float[np.ndarray, "V"]]:
    """Distance in metres to the nearest vehicle lane, and the angle to it in degrees.

    Angles are between undirected lines, 0 to 90. Without a lane the distance is infinite.
    """
    points, direction = _road(road_map).points
    if not len(points):
        return np.full(len(position_m), np.inf), np.zeros(len(position_m))
    nearest, lane_m = nearest_points(position_m, points)
    return lane_m, folded_deg(heading_rad - direction[nearest])


def _vehicles(agents: AgentStates) -> Bool[np.ndarray, "A"]:
    return agents.is_valid[:, 0] & agents.kind_mask((AgentKind.VEHICLE,))


@lru_cache(maxsize=16)
def _road(road_map: RoadMap) -> Road:
    lanes = [lane for lane in road_map.lanes if lane.kind is not LaneKind.BIKE]
    return Road(
        lines_m=[lane.centerline_m for lane in lanes],
        num_successors=[len(lane.successors) for lane in lanes],
        ground=drivable_ground(road_map),
    )
