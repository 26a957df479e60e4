"""The port for motion predictors: history and map in, K trajectories out; NumPy only.

Scene-Attack was made to test predictors. One needs neither torch nor a base class of
this project: an object with ``name`` and ``predict(request)`` is a predictor.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import GenerationError
from pd_editor.scene.agent_states import STEPPED, AgentStates
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import check_finite


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentHistory(AgentStates):
    """A agents up to the current step, in the scene frame; arrays are read-only.

    The last step is the current one; where ``is_valid`` is false the history is not known.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionRequest:
    """What to predict, and what may be known for it: nothing after the current step."""

    scenario_id: str
    agents: AgentHistory
    """The agents to predict; each is present at the current step."""
    others: AgentHistory
    """The remaining agents that are present at the current step."""
    road_map: RoadMap
    """The road, warped where the scene is."""
    origin_city_m: Float[np.ndarray, "2"]
    """Origin of the scene frame in the city frame."""
    num_steps: int
    """Future steps F to predict."""
    step_s: float
    """Time between two steps, in the history and in the prediction."""
    num_modes: int
    """Trajectories that are wanted of each agent; another number is taken as well."""
    seed: int
    """For predictors that sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """K trajectories of each of A agents, with their probabilities."""

    position_m: Float[np.ndarray, "A K F 2"]
    """Box centres in the scene frame; the first step follows the current one."""
    probability: Float[np.ndarray, "A K"]
    """At least 0; the sum does not matter."""


@runtime_checkable
class Predictor(Protocol):
    """Anything that predicts the trajectories of agents from their history."""

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        ...

    def predict(self, request: PredictionRequest) -> Prediction:
        """Predict all agents of the request at once."""
        ...


def prediction_request(
    scenario: Scenario, agent_ids: tuple[str, ...], *, num_modes: int, seed: int
) -> PredictionRequest:
    """What a predictor sees of a scenario.

    Raises:
        EditError: an agent is not in the scenario.
        GenerationError: an agent is not present at the current step.
    """
    now, agents = scenario.current_step, scenario.agents
    rows = agents.rows(agent_ids)
    is_present = agents.is_valid[:, now].copy()
    if not is_present[rows].all():
        missing = agent_ids[int(np.argmin(is_present[rows]))]
        raise GenerationError(
            f"Agent {missing} is not present at the current step, so it has no state "
            "to predict from."
        )
    is_present[rows] = False
    return PredictionRequest(
        scenario_id=scenario.scenario_id,
        agents=history(agents.taken(rows), now + 1),
        others=history(agents.taken(np.flatnonzero(is_present)), now + 1),
        road_map=scenario.road_map,
        origin_city_m=scenario.origin_city_m,
        num_steps=scenario.time_axis.num_future_steps,
        step_s=scenario.time_axis.step_s,
        num_modes=num_modes,
        seed=seed,
    )


def history(agents: AgentTracks, num_steps: int) -> AgentHistory:
    """The first steps of some tracks, without what comes later."""

    def past(values: np.ndarray) -> np.ndarray:
        # A copy: the base of a view would show the future.
        known = values[:, :num_steps].copy()
        known.flags.writeable = False
        return known

    return AgentHistory(
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        **{name: past(getattr(agents, name)) for name in STEPPED},
    )


def checked_prediction(
    answer: object, request: PredictionRequest, name: str
) -> Prediction:
    """The answer of a predictor as float arrays.

    Raises:
        GenerationError: it is no prediction, has other shapes, or holds NaN.
    """
    if not hasattr(answer, "position_m"):
        raise GenerationError(
            f"The predictor {name} returned a {type(answer).__name__}; expected a "
            "Prediction (pd_editor.scene.prediction)."
        )
    position = np.asarray(getattr(answer, "position_m", None))
    probability = np.asarray(getattr(answer, "probability", None))
    num_agents, num_steps = len(request.agents.ids), request.num_steps
    num_modes = position.shape[1] if position.ndim == 4 else 0
    for field, values, expected, shape in (
        ("position_m", position, (num_agents, num_modes, num_steps, 2), "A, K, F, 2"),
        ("probability", probability, (num_agents, num_modes), "A, K"),
    ):
        if values.shape != expected or not num_modes:
            raise GenerationError(
                f"The predictor {name} returned {field} with the shape "
                f"{values.shape}; expected ({shape}) with A = {num_agents} agents, "
                f"K = 1 or more trajectories, F = {num_steps} steps."
            )
        if values.dtype.kind not in "fiu":
            raise GenerationError(
                f"The predictor {name} returned {field} of type {values.dtype}; expected "
                "numbers."
            )
        check_finite(field, values, request.agents.ids, ("trajectory", "step"))
    if (probability < 0).any():
        raise GenerationError(
            f"The predictor {name} returned a probability below 0; expected 0 or more."
        )
    return Prediction(
        position_m=position.astype(float), probability=probability.astype(float)
    )
