"""Tasks of an evaluation: trajectories from recorded states, or complete traffic."""

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.analysis.metrics.lanes import OFF_LANE_M
from pd_editor.analysis.metrics.road import map_points, nearest_points
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.base.errors import GenerationError
from pd_editor.generation.features.scene_features import scene_center
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS, AgentCategory, AgentKind
from pd_editor.scene.generation import GenerationRequest, Region
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

StatesChoice = Literal["recorded", "sampled"]
AgentsChoice = Literal["all", "paper"]

SAMPLED_HALF_SIDE_M: Final = 62.0
"""Half the side of the square around the focal agent in which states are sampled."""
BOUNDARY_M = 2.0


@dataclass(frozen=True, kw_only=True)
class EvaluationTask:
    """Whether initial states are recorded or sampled, and which agents are evaluated."""

    states: StatesChoice = "recorded"
    """With ``recorded``, agents keep their states and trajectories are generated. With
    ``sampled``, initial states are sampled as well: as many agents of each kind as the log
    has in the square."""
    agents: AgentsChoice = "all"
    """With ``paper``, only agents that the paper's code evaluates at this stage."""

    @property
    def samples_states(self) -> bool:
        """Whether initial states are sampled."""
        return self.states == "sampled"

    def request(
        self, recorded: Scenario, scenario: Scenario, *, num_samples: int, seed: int
    ) -> GenerationRequest:
        """Request that every method gets.

        The recorded scene determines the evaluated agents; ``scenario`` is the same
        scene under the road condition.

        Raises:
            GenerationError: no road user is left.
        """
        if self.samples_states or self.agents == "paper":
            rows = self._rows(recorded)
            scenario = replace(scenario, agents=scenario.agents.taken(rows))
        ids = drivable_agent_ids(scenario)
        request = GenerationRequest(
            scenario=scenario, agent_ids=ids, num_samples=num_samples, seed=seed
        )
        if not self.samples_states:
            return request
        x, y = scene_center(recorded).tolist()
        return replace(
            request,
            resampled_state_ids=ids,
            region=Region(center_m=(x, y), half_side_m=SAMPLED_HALF_SIDE_M),
            # Agents that pass the paper's filter are on the road.
            only_on_road=self.agents == "paper",
        )

    def _rows(self, recorded: Scenario) -> Int[np.ndarray, "A"]:
        view = recorded_traffic(recorded)
        wanted = np.ones(len(view), bool)
        if self.agents == "paper":
            keeps = (
                paper_init_agents if self.samples_states else paper_trajectory_agents
            )
            wanted &= keeps(view)
        if self.samples_states:
            offset = view.agents.position_m[:, 0] - scene_center(recorded)
            wanted &= (np.abs(offset) <= SAMPLED_HALF_SIDE_M).all(axis=1)
        if not wanted.any():
            raise GenerationError(
                "None of the requested agents exists at the current step."
            )
        ids = [name for name, keep in zip(view.agents.ids, wanted, strict=True) if keep]
        return recorded.agents.rows(ids)


DRIVING: Final = EvaluationTask()
"""Task with all agents and their recorded states."""


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
