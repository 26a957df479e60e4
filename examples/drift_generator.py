"""A generator in a few lines: agents keep their velocity, each with a random turn rate.

pd-editor generate signalised-junction --model examples.drift_generator:DriftGenerator \
        --samples 3 --out out
pd-editor edit --models examples.drift_generator:DriftGenerator
"""

from collections.abc import Iterator

import numpy as np

from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    TrafficSample,
)

TURN_RATE_RADPS = 0.05


class DriftGenerator:
    """Yields progress, which is where a run can be cancelled, and returns samples."""

    name = "drift"

    def generate(self, request: GenerationRequest) -> Iterator[GenerationProgress]:
        """Generate ``num_samples`` samples of the agents that are asked for."""
        samples = []
        for number in range(request.num_samples):
            random = np.random.default_rng([request.seed, number])
            samples.append(self._sample(request, random))
            yield GenerationProgress(
                fraction=(number + 1) / request.num_samples, message="Drifting"
            )
        return GeneratedTraffic(
            samples=tuple(samples), generator=self.name, seed=request.seed
        )

    def _sample(
        self, request: GenerationRequest, random: np.random.Generator
    ) -> TrafficSample:
        scenario, now = request.scenario, request.scenario.current_step
        agents = scenario.agents.taken(scenario.agents.rows(request.agent_ids))
        time_s = scenario.time_axis.times_s()[now:]
        turn = random.normal(0, TURN_RATE_RADPS, (len(agents), 1)) * time_s
        direction = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        start = agents.velocity_mps[:, now, None]
        across = np.stack([-start[..., 1], start[..., 0]], axis=-1)
        velocity = direction[..., :1] * start + direction[..., 1:] * across
        moved = np.cumsum(velocity[:, 1:], axis=1) * scenario.time_axis.step_s
        return TrafficSample(
            ids=agents.ids,
            kinds=agents.kinds,
            size_m=agents.size_m,
            position_m=agents.position_m[:, now, None]
            + np.concatenate([np.zeros_like(moved[:, :1]), moved], axis=1),
            heading_rad=agents.heading_rad[:, now, None] + turn,
            velocity_mps=velocity,
        )
