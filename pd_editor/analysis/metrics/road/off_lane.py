"""Off-road metrics: the paper's 4 m rule, its corrections, and the drivable area."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool

from pd_editor.analysis.metrics.road.map_points import (
    map_points,
    nearest_points,
    paths_within,
)
from pd_editor.analysis.metrics.road.off_road import is_off_road
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import (
    MetricValues,
    any_step,
    mean_over_steps,
    measured,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.scenario import Scenario

OFF_LANE_M: Final = 4.0
BEYOND_ROADS_M: Final = 20.0
"""Agents further from all lanes drive on roads that are not mapped: 13 % of the vehicles
of ``val``, 9 % of ``train``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OffLane:
    """Off-road tests of A evaluated agents at H steps, the current one first.

    They are not valid for pedestrians.
    """

    is_valid: Bool[np.ndarray, "A H"]
    is_far: Bool[np.ndarray, "A H"]
    """Whether no centre-line point is within 4 m."""
    is_outside: Bool[np.ndarray, "A H"]
    """Whether the centre is outside the drivable area."""

    def values(self) -> dict[str, MetricValues]:
        """Off-road metrics by name, each [A]."""
        valid, far, outside = self.is_valid, self.is_far, self.is_outside
        whole = np.all(far | ~valid, axis=1)
        return {
            "init_off_road_4m": measured("init_off_road_4m", far[:, 0], valid[:, 0]),
            "off_road_4m_whole_path": measured(
                "off_road_4m_whole_path", whole, np.any(valid, axis=1)
            ),
            "off_road_4m": any_step("off_road_4m", far, valid),
            "off_road_4m_steps": mean_over_steps("off_road_4m_steps", far, valid),
            "init_off_drivable": measured(
                "init_off_drivable", outside[:, 0], valid[:, 0]
            ),
            "off_drivable": any_step("off_drivable", outside, valid),
            "off_drivable_steps": mean_over_steps("off_drivable_steps", outside, valid),
        }


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


def off_lane(view: TrafficView) -> OffLane:
    """Off-road tests of the evaluated agents that follow lanes."""
    is_valid = evaluated_steps(view)
    position = view.agents.position_m
    center = map_points(view.scenario.road_map).center_m
    is_outside = np.zeros(is_valid.shape, bool)
    is_outside[is_valid] = is_off_road(view.scenario, position[is_valid])
    is_near = paths_within(position, is_valid, center, OFF_LANE_M)
    return OffLane(is_valid=is_valid, is_far=is_valid & ~is_near, is_outside=is_outside)


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
