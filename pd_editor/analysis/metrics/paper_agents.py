"""Agents that the paper's code evaluates, for figures comparable with the paper's."""

import numpy as np
from jaxtyping import Bool

from pd_editor.analysis.metrics.road.map_points import map_points, nearest_points
from pd_editor.analysis.metrics.road.off_lane import OFF_LANE_M
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS, AgentCategory, AgentKind

BOUNDARY_M = 2.0


def paper_init_agents(view: TrafficView) -> Bool[np.ndarray, "A"]:
    """Agents of the first stage: vehicles that exist at the current and the last step.

    They must also be "in lane" at the current step: within 2 m of a boundary point or
    4 m of a centre point. This lowers the paper's off-road rate of recordings.
    """
    agents = view.agents
    evaluated = np.array([kind is AgentKind.VEHICLE for kind in agents.kinds], bool)
    evaluated &= agents.is_valid[:, 0] & agents.is_valid[:, -1]
    points = map_points(view.scenario.road_map)
    in_lane = np.zeros(len(view), bool)
    for targets, reach in (
        (points.boundary_m, BOUNDARY_M),
        (points.center_m, OFF_LANE_M),
    ):
        if len(targets):
            distance = nearest_points(agents.position_m[:, 0], targets)[1]
            in_lane |= distance <= reach
    return evaluated & in_lane


def paper_trajectory_agents(view: TrafficView) -> Bool[np.ndarray, "A"]:
    """Agents of the second stage: scored or focal motor vehicles at both ends."""
    recorded = view.scenario.agents
    category = dict(zip(recorded.ids, recorded.categories, strict=True))
    return np.array(
        [
            kind in MOTOR_VEHICLE_KINDS
            and category.get(agent_id, AgentCategory.FRAGMENT) >= AgentCategory.SCORED
            for agent_id, kind in zip(view.agents.ids, view.agents.kinds, strict=True)
        ],
        bool,
    ) & (view.agents.is_valid[:, 0] & view.agents.is_valid[:, -1])
