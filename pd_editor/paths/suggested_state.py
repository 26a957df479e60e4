"""The state that the road suggests for an agent placed at a point."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.paths.nearest_lane import nearest_lanes
from pd_editor.paths.route_choice import lane_kinds_of
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.scenario import Scenario

SUGGESTED_SPEED_MPS: Final[dict[AgentKind, float]] = {
    AgentKind.VEHICLE: 8.0,
    AgentKind.BUS: 7.0,
    AgentKind.MOTORCYCLIST: 8.0,
    AgentKind.CYCLIST: 4.5,
    AgentKind.PEDESTRIAN: 1.4,
}
"""Speed of a placed agent where no agent on its lane shows another."""
LANE_REACH_M: Final = 4.0


def suggested_state(
    scenario: Scenario, point_m: Float[np.ndarray, "2"], kind: AgentKind
) -> tuple[float, float, float, float]:
    """x, y, heading and speed that the lane at a point suggests for a kind.

    Lane followers within reach of a lane take its direction, and the median speed of
    moving agents on that lane; others look east and take their kind's usual speed.
    """
    speed = SUGGESTED_SPEED_MPS.get(kind, 0.0)
    x, y = float(point_m[0]), float(point_m[1])
    if kind not in LANE_FOLLOWER_KINDS:
        return x, y, 0.0, speed
    match = nearest_lanes(scenario.road_map, point_m[None], kinds=lane_kinds_of(kind))
    if not match.is_valid[0] or match.distance_m[0] > LANE_REACH_M:
        return x, y, 0.0, speed
    lane_speed = _speed_on_lane(scenario, int(match.lane_id[0]))
    return (
        x,
        y,
        float(match.heading_rad[0]),
        round(speed if lane_speed is None else lane_speed, 1),
    )


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
