"""Default state of an agent placed at a point, from the lane and the traffic there."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind, default_sizes_m
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.paths.car_following import STANDSTILL_GAP_M
from pd_editor.scene.paths.lanes.lane_routes import (
    SAMPLE_SPACING_M,
    SAMPLED_BEHIND_M,
    lane_routes,
)
from pd_editor.scene.paths.lanes.nearest_lane import LaneMatch, nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import MAX_TURN_RAD, lane_kinds_of
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

SUGGESTED_SPEED_MPS: Final[dict[AgentKind, float]] = {
    AgentKind.VEHICLE: 8.0,
    AgentKind.BUS: 7.0,
    AgentKind.MOTORCYCLIST: 8.0,
    AgentKind.CYCLIST: 4.5,
    AgentKind.PEDESTRIAN: 1.4,
}
"""Speed of a placed agent without moving agents on its lane."""
LANE_REACH_M: Final = 4.0
LOOK_AHEAD_S: Final = 6.0
"""Agents ahead that are reached later than this do not limit the speed."""
SIDE_GAP_M: Final = 0.3


@dataclass(frozen=True, kw_only=True)
class SuggestedState:
    """Pose and speed of an agent at the current step."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


def suggested_heading(
    road_map: RoadMap, point_m: Float[np.ndarray, "2"], kind: AgentKind
) -> float:
    """Direction of the lane that a kind follows at a point; 0 (east) without one."""
    match = _lane_at(road_map, point_m, kind)
    return 0.0 if match is None else float(match.heading_rad[0])


def suggested_state(
    scenario: Scenario,
    point_m: Float[np.ndarray, "2"],
    kind: AgentKind,
    heading_rad: float | None = None,
) -> SuggestedState:
    """Suggest a state from the lane at a point and the agents ahead.

    Lane followers within reach of a lane take its direction, and the median speed of
    moving agents on that lane; others face east with the default speed of their kind.
    The speed is limited so that the agent ahead is not reached in the next seconds.
    """
    match = _lane_at(scenario.road_map, point_m, kind)
    lane_heading = None if match is None else float(match.heading_rad[0])
    if heading_rad is None:
        heading_rad = lane_heading or 0.0
    speed = SUGGESTED_SPEED_MPS.get(kind, 0.0)
    path = point_m + np.arange(0.0, speed * LOOK_AHEAD_S * 2)[:, None] * unit_vector(
        np.array(heading_rad)
    )
    if match is not None and lane_heading is not None:
        turn = float(wrap_angle(np.array([heading_rad - lane_heading]))[0])
        if abs(turn) < MAX_TURN_RAD:
            lane_id = int(match.lane_id[0])
            shown = _speed_on_lane(scenario, lane_id)
            speed = speed if shown is None else shown
            path = _along_lane(scenario.road_map, match, kind, speed * LOOK_AHEAD_S)
    speed = min(speed, _speed_to_agent_ahead(scenario, path, kind))
    return SuggestedState(
        x_m=float(point_m[0]),
        y_m=float(point_m[1]),
        heading_rad=heading_rad,
        speed_mps=round(speed, 1),
    )


def _lane_at(
    road_map: RoadMap, point_m: Float[np.ndarray, "2"], kind: AgentKind
) -> LaneMatch | None:
    """Nearest lane within reach that a kind follows; None without one."""
    if kind not in LANE_FOLLOWER_KINDS:
        return None
    match = nearest_lanes(road_map, point_m[None], kinds=lane_kinds_of(kind))
    is_near = match.is_valid[0] and match.distance_m[0] <= LANE_REACH_M
    return match if is_near else None


def _along_lane(
    road_map: RoadMap, match: LaneMatch, kind: AgentKind, length_m: float
) -> Float[np.ndarray, "M 2"]:
    """Points of the straightest route from a point of a lane, 1 m apart."""
    along = float(match.along_m[0])
    route = lane_routes(road_map).from_lane(
        int(match.lane_id[0]), along + length_m, lane_kinds_of(kind)
    )[0]
    first = round((SAMPLED_BEHIND_M + along) / SAMPLE_SPACING_M)
    return route.samples_m[first : first + round(length_m / SAMPLE_SPACING_M) + 10]


def _speed_to_agent_ahead(
    scenario: Scenario, path_m: Float[np.ndarray, "M 2"], kind: AgentKind
) -> float:
    """Highest constant speed at which the nearest agent on a path is not reached."""
    agents, step = scenario.agents, scenario.current_step
    rows = np.flatnonzero(agents.is_valid[:, step])
    if not len(rows) or len(path_m) < 2:
        return np.inf
    ((length, width),) = default_sizes_m((kind,))
    gaps = np.linalg.norm(
        agents.position_m[rows, step][:, None] - path_m[None], axis=-1
    )
    at = gaps.argmin(axis=1)
    # Agents that are stationary across the path block it with their length.
    half = agents.size_m[rows] / 2
    is_ahead = (at > 0) & (gaps.min(axis=1) < half[:, 1] + width / 2 + SIDE_GAP_M)
    if not is_ahead.any():
        return np.inf
    free = at * SAMPLE_SPACING_M - half[:, 0] - length / 2 - STANDSTILL_GAP_M
    free = np.where(is_ahead, free, np.inf)
    ahead = int(free.argmin())
    last = min(
        step + round(LOOK_AHEAD_S / scenario.time_axis.step_s), agents.num_steps - 1
    )
    is_there = agents.is_valid[rows[ahead], step : last + 1]
    track = agents.position_m[rows[ahead], step : last + 1][is_there]
    drives = float(np.linalg.norm(np.diff(track, axis=0), axis=-1).sum())
    seconds = max(len(track) - 1, 1) * scenario.time_axis.step_s
    return max(float(free[ahead]) + drives, 0.0) / seconds


def _speed_on_lane(scenario: Scenario, lane_id: int) -> float | None:
    agents, step = scenario.agents, scenario.current_step
    speed = agents.speed_mps()[:, step]
    rows = np.flatnonzero(
        agents.is_valid[:, step] & agents.kind_mask(LANE_FOLLOWER_KINDS) & (speed > 1.0)
    )
    if not len(rows):
        return None
    match = nearest_lanes(
        scenario.road_map,
        agents.position_m[rows, step],
        heading_rad=agents.heading_rad[rows, step],
    )
    on_lane = match.is_valid & (match.lane_id == lane_id) & (match.distance_m < 2.0)
    return float(np.median(speed[rows[on_lane]])) if on_lane.any() else None
