"""A motion predictor as a generator of trajectories."""

import time
from collections.abc import Generator
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import GenerationError
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    TrafficSample,
)
from pd_editor.scene.prediction import (
    AgentHistory,
    Predictor,
    checked_prediction,
    prediction_request,
)

_LEAST_STEP_M: Final = 0.02
"""An agent that moves less in a step keeps its heading."""


class PredictorGenerator:
    """Sample s takes the trajectory of each agent that is the s-th most probable.

    Where a predictor gives fewer trajectories than samples are asked for, it begins
    again with the most probable one. It samples no initial states.
    """

    def __init__(self, predictor: Predictor) -> None:
        """Wrap a predictor."""
        self._predictor = predictor

    @property
    def name(self) -> str:
        """The predictor's own name."""
        return self._predictor.name

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress, return the traffic.

        Raises:
            GenerationError: there is nothing to predict, or the prediction is wrong.
            EditError: an agent is not in the scenario.
        """
        began = time.perf_counter()
        scenario = request.scenario
        asked = prediction_request(
            scenario,
            request.agent_ids,
            num_modes=request.num_samples,
            seed=request.scene_seed,
        )
        if not asked.num_steps:
            raise GenerationError(
                f"Scenario {asked.scenario_id} has no steps after the current one to "
                "predict."
            )
        yield GenerationProgress(fraction=0.0, message="Predicting")
        found = checked_prediction(self._predictor.predict(asked), asked, self.name)
        order = np.argsort(-found.probability, axis=1, kind="stable")
        rows, num_modes = np.arange(len(order)), order.shape[1]
        return GeneratedTraffic(
            samples=tuple(
                _sample(
                    asked.agents,
                    found.position_m[rows, order[:, number % num_modes]],
                    asked.step_s,
                )
                for number in range(request.num_samples)
            ),
            generator=self.name,
            seed=request.seed,
            elapsed_s=time.perf_counter() - began,
        )


def _sample(
    agents: AgentHistory, later_m: Float[np.ndarray, "A F 2"], step_s: float
) -> TrafficSample:
    """Trajectories with headings and velocities, the current state first."""
    now_m, now_mps = agents.position_m[:, -1:], agents.velocity_mps[:, -1:]
    position = np.concatenate([now_m, later_m], axis=1)
    step = np.diff(position, axis=1)
    heading = np.concatenate(
        [agents.heading_rad[:, -1:], np.arctan2(step[..., 1], step[..., 0])], axis=1
    )
    moves = np.hypot(step[..., 0], step[..., 1]) >= _LEAST_STEP_M
    turns = np.concatenate([np.ones((len(step), 1), bool), moves], axis=1)
    last = np.maximum.accumulate(np.where(turns, np.arange(turns.shape[1]), 0), axis=1)
    heading = np.take_along_axis(heading, last, axis=1)
    velocity = np.concatenate([now_mps, step / step_s], axis=1)
    return TrafficSample.of(agents, (position, heading, velocity))
