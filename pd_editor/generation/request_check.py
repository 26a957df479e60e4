"""Validation of requests to the model."""

from typing import Final

import numpy as np
from jaxtyping import Int

from pd_editor.base.errors import GenerationError
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.generation import LANE_GUIDANCE, GenerationRequest
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_cut import FUTURE_S, is_long

MOST_AGENTS: Final = 500


def check_request(request: GenerationRequest) -> None:
    """Raise for requests that cannot be met.

    Raises:
        GenerationError: numbers, agents, states or times are not valid.
        EditError: an agent is not in the scenario.
    """
    scenario, agents = request.scenario, request.scenario.agents
    if len(set(request.agent_ids)) < len(request.agent_ids):
        raise GenerationError("An agent was requested twice; each may be named once.")
    if not set(request.resampled_state_ids) <= set(request.agent_ids):
        raise GenerationError(
            "Only agents whose trajectories are generated can get another state."
        )
    for setting in request.settings:
        if setting.name == LANE_GUIDANCE and not 0 <= setting.weight <= 1:
            raise GenerationError(
                f"The strength of the guidance to the lanes is {setting.weight:g}; "
                "expected 0 to 1."
            )
    strange = [kind for kind in request.num_new_agents if kind not in ROAD_USER_KINDS]
    if strange:
        raise GenerationError(f"The model places road users only, not {strange[0]}.")
    count = num_present(scenario)
    if count > MOST_AGENTS:
        raise GenerationError(
            f"The scene has {count} agents; the model takes {MOST_AGENTS}."
        )
    axis = scenario.time_axis
    if is_long(scenario):
        raise GenerationError(
            f"The scenario's future lasts {axis.num_future_steps * axis.step_s:.1f} s; "
            f"the model samples {FUTURE_S:g} s. Open it cut: in the browser with the "
            "button under Scene, else with --until 6 (open_scenario: until_s=6)."
        )
    if not scenario.road_map.lanes:
        raise GenerationError("The scenario has no lanes; the model needs a road.")
    _check_states(request, agents.rows(request.agent_ids))


def num_present(scenario: Scenario) -> int:
    """Number of agents at the current step."""
    return int(scenario.agents.is_valid[:, scenario.current_step].sum())


def _check_states(request: GenerationRequest, rows: Int[np.ndarray, "G"]) -> None:
    agents, now = request.scenario.agents, request.scenario.current_step
    for row in rows:
        name = agents.ids[row]
        if name in request.resampled_state_ids:
            continue
        if not agents.is_valid[row, now]:
            raise GenerationError(
                f"Agent {name} is not there at the current step, so it has no state "
                "to go on from."
            )
        state = (*agents.position_m[row, now], *agents.velocity_mps[row, now])
        if not np.isfinite([*state, agents.heading_rad[row, now]]).all():
            raise GenerationError(
                f"Agent {name} has no finite state at the current step; expected one."
            )
