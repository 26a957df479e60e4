"""Lateral and angular deviation of agents from their reachable lanes."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.road.off_lane import evaluated_steps
from pd_editor.analysis.metrics.road.reachable_lanes import (
    reachable_lanes,
    usable_lanes,
)
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, mean_over_steps, measured
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.thresholds import MOVING_MPS

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
    is_reachable: Bool[np.ndarray, "A L"]

    def values(self) -> dict[str, MetricValues]:
        """Lane metrics by name, each [A]; the current step does not count."""
        later = self.is_valid[:, 1:]
        last = later.shape[1] - later[:, ::-1].argmax(axis=1) if later.size else 0
        final = self.lateral_m[np.arange(len(later)), last]
        return {
            "lateral_deviation_mean": mean_over_steps(
                "lateral_deviation_mean", self.lateral_m[:, 1:], later
            ),
            "lateral_deviation_final": measured(
                "lateral_deviation_final", final, np.any(later, axis=1)
            ),
            "angular_deviation_mean": mean_over_steps(
                "angular_deviation_mean", self.angle_deg[:, 1:], later
            ),
            "wrong_way": mean_over_steps(
                "wrong_way", self.is_wrong_way[:, 1:], self.can_be_wrong_way[:, 1:]
            ),
        }


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
        is_reachable=reachable,
    )


def path_length_m(
    position_m: Float[np.ndarray, "A H 2"], is_valid: Bool[np.ndarray, "A H"]
) -> Float[np.ndarray, "A"]:
    """Length of each path over pairs of consecutive valid steps."""
    step = np.diff(position_m, axis=1)
    both = is_valid[:, 1:] & is_valid[:, :-1]
    return np.where(both, np.hypot(step[..., 0], step[..., 1]), 0.0).sum(axis=1)
