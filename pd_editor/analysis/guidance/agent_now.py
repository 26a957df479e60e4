"""An agent at the current step, and where it could get."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.limits import (
    MAX_BRAKING_MPS2,
    MAX_SPEED_MPS,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.paths.candidate_grid import Start, plan_paths
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentNow:
    """An agent at the current step, with the paths that it could take."""

    scenario: Scenario
    row: int
    lasts_s: float | None = None
    """Length of its trajectory; None: to the end of the scenario."""

    @property
    def name(self) -> str:
        """Name of the agent in sentences."""
        return f"agent {self.scenario.agents.ids[self.row]}"

    @property
    def subject(self) -> str:
        """Name of the agent at the start of sentences."""
        return f"Agent {self.scenario.agents.ids[self.row]}"

    @cached_property
    def position_m(self) -> Float[np.ndarray, "2"]:
        """Position."""
        return self.scenario.agents.position_m[self.row, self.scenario.current_step]

    @cached_property
    def heading_rad(self) -> float:
        """Heading."""
        agents, now = self.scenario.agents, self.scenario.current_step
        return float(agents.heading_rad[self.row, now])

    @cached_property
    def speed_mps(self) -> float:
        """Speed."""
        agents, now = self.scenario.agents, self.scenario.current_step
        return float(np.hypot(*agents.velocity_mps[self.row, now]))

    @property
    def is_driver(self) -> bool:
        """Whether the agent belongs on the road."""
        return self.scenario.agents.kinds[self.row] in LANE_FOLLOWER_KINDS

    @property
    def duration_s(self) -> float:
        """Length of trajectories."""
        axis = self.scenario.time_axis
        whole_s = axis.num_future_steps * axis.step_s
        return whole_s if self.lasts_s is None else self.lasts_s

    @cached_property
    def paths_m(self) -> Float[np.ndarray, "P M 2"]:
        """Paths that it could take, one point every ``SPACING_M``."""
        one = self.scenario
        return _paths_m(
            one.road_map, one.agents, one.current_step, self.row, self.duration_s
        )

    def reach_m(self, time_s: float) -> tuple[float, float]:
        """Least and greatest distance that can be driven in a time."""
        speed = self.speed_mps
        stop_s = speed / MAX_BRAKING_MPS2
        braking_s = min(time_s, stop_s)
        least = speed * braking_s - MAX_BRAKING_MPS2 * braking_s**2 / 2
        gained_s = min(time_s, max(MAX_SPEED_MPS - speed, 0.0) / FIRM_ACCELERATION_MPS2)
        fastest = speed + FIRM_ACCELERATION_MPS2 * gained_s
        most = (speed + fastest) / 2 * gained_s + fastest * (time_s - gained_s)
        return least, most


@lru_cache(maxsize=64)
def _paths_m(
    road_map: RoadMap, agents: AgentTracks, step: int, row: int, duration_s: float
) -> Float[np.ndarray, "P M 2"]:
    """Planned paths: terms are checked before a run, after it and while they change."""
    start = Start.at(agents, step, np.array([row]))
    paths = plan_paths(road_map, start, duration_s).paths
    points = np.stack([paths.x_m, paths.y_m], axis=-1)
    points.flags.writeable = False
    return points
