"""What methods are asked to fill: recorded scenes, or the road alone."""

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Int

from pd_editor.errors import GenerationError
from pd_editor.features.scene_features import scene_center
from pd_editor.generation import GenerationRequest, Region
from pd_editor.metrics.paper_agents import paper_init_agents, paper_trajectory_agents
from pd_editor.metrics.traffic_view import recorded_traffic
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_choice import drivable_agent_ids

StatesChoice = Literal["recorded", "drawn"]
AgentsChoice = Literal["all", "paper"]

DRAWN_HALF_SIDE_M: Final = 62.0
"""States are drawn in a square of twice this side around the focal agent."""


@dataclass(frozen=True, kw_only=True)
class EvaluationTask:
    """Whose states are kept, and who is in the scenes at all."""

    states: StatesChoice = "recorded"
    """With ``recorded``, agents keep them and futures are drawn. With ``drawn``, states
    are drawn as well: as many agents of each kind as the log has in the square."""
    agents: AgentsChoice = "all"
    """With ``paper``, only those that the paper's code keeps at this stage."""

    @property
    def samples_states(self) -> bool:
        """Whether agents are placed, not only driven."""
        return self.states == "drawn"

    def request(
        self, recorded: Scenario, scenario: Scenario, *, num_samples: int, seed: int
    ) -> GenerationRequest:
        """What every method is asked.

        Args:
            recorded: The scene as it was recorded, by which agents are chosen.
            scenario: The same, its road perhaps bent.
            num_samples: Samples of each scene.
            seed: Of the scene.

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
            redrawn_state_ids=ids,
            region=Region(center_m=(x, y), half_side_m=DRAWN_HALF_SIDE_M),
            # Whom the paper's filter keeps is on the road.
            only_on_road=self.agents == "paper",
        )

    def _rows(self, recorded: Scenario) -> Int[np.ndarray, "A"]:
        view = recorded_traffic(recorded)
        kept = np.ones(len(view), bool)
        if self.agents == "paper":
            keeps = (
                paper_init_agents if self.samples_states else paper_trajectory_agents
            )
            kept &= keeps(view)
        if self.samples_states:
            offset = view.agents.position_m[:, 0] - scene_center(recorded)
            kept &= (np.abs(offset) <= DRAWN_HALF_SIDE_M).all(axis=1)
        if not kept.any():
            raise GenerationError(
                "None of the agents that are asked for is there at the current step."
            )
        ids = [name for name, keep in zip(view.agents.ids, kept, strict=True) if keep]
        return recorded.agents.rows(ids)


DRIVING: Final = EvaluationTask()
"""All agents from their recorded states."""
