"""Tasks of an evaluation: trajectories from recorded states, or complete traffic."""

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Int

from pd_editor.analysis.metrics.paper_agents import (
    paper_init_agents,
    paper_trajectory_agents,
)
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.base.errors import GenerationError
from pd_editor.generation.features.scene_features import scene_center
from pd_editor.scene.generation import GenerationRequest, Region
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

StatesChoice = Literal["recorded", "sampled"]
AgentsChoice = Literal["all", "paper"]

SAMPLED_HALF_SIDE_M: Final = 62.0
"""Half the side of the square around the focal agent in which states are sampled."""


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
