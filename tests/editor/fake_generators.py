"""Generators whose answers are known."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import (
    CAPABILITIES,
    Capability,
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    GuidanceReport,
    TrafficSample,
)


@dataclass
class DriftGenerator:
    """Everybody drifts along +x at a speed that the seed decides."""

    name: str = "drift"
    extra_mps: float = 0.0
    num_steps: int = 4
    on_step: Callable[[int], None] = lambda _: None
    steps_begun: list[int] = field(default_factory=list)
    was_closed: threading.Event = field(default_factory=threading.Event)

    def generate(self, request):
        try:
            for step in range(self.num_steps):
                self.steps_begun.append(step)
                self.on_step(step)
                yield GenerationProgress(
                    fraction=(step + 1) / self.num_steps, message=f"step {step}"
                )
        finally:
            self.was_closed.set()
        scenario = request.scenario
        agents, axis = scenario.agents, scenario.time_axis
        rows = agents.rows(request.agent_ids)
        speed = np.random.default_rng(request.seed).uniform(1, 10) + self.extra_mps
        time = np.arange(axis.num_future_steps + 1) * axis.step_s
        way = np.stack([speed * time, 0 * time], axis=-1)
        position = agents.position_m[rows, axis.current_step][:, None] + way
        heading = np.repeat(
            agents.heading_rad[rows, [axis.current_step]][:, None], len(time), 1
        )
        sample = TrafficSample(
            ids=request.agent_ids,
            kinds=tuple(agents.kinds[row] for row in rows),
            size_m=agents.size_m[rows],
            position_m=position,
            heading_rad=heading,
            velocity_mps=np.broadcast_to([speed, 0.0], position.shape).copy(),
        )
        return GeneratedTraffic(
            samples=(sample,), generator=self.name, seed=request.seed
        )


@dataclass
class ReadyGenerator:
    """Answers any request with samples that were made before."""

    samples: tuple[TrafficSample, ...]
    guidance: tuple[GuidanceReport, ...] = ()

    def generate(self, _request):
        yield GenerationProgress(fraction=1.0, message="ready")
        return GeneratedTraffic(
            samples=self.samples, generator="ready", guidance=self.guidance
        )


@dataclass
class PlacingGenerator:
    """New agents stand in a row from the origin on; others keep standing."""

    name: str = "placing"
    supports: frozenset[Capability] = CAPABILITIES
    requests: list[GenerationRequest] = field(default_factory=list)

    def generate(self, request):
        self.requests.append(request)
        yield GenerationProgress(fraction=1.0, message="placed")
        agents, axis = request.scenario.agents, request.scenario.time_axis
        rows = agents.rows(request.agent_ids)
        counts = request.num_new_agents
        if request.samples_num_agents:
            counts = {AgentKind.VEHICLE: 2}
        new = [kind for kind, count in counts.items() for _ in range(count)]
        kinds = (*(agents.kinds[row] for row in rows), *new)
        states = agents.position_m[rows, axis.current_step]
        drawn = np.isin(request.agent_ids, request.resampled_state_ids)
        samples = []
        for number in range(request.num_samples):
            placed = np.arange(len(new) + drawn.sum())[:, None] * [8.0, 0.0]
            placed = placed + np.array([0.0, float(number)])
            state = np.concatenate([states, placed[drawn.sum() :]])
            state[: len(rows)][drawn] = placed[: drawn.sum()]
            shape = (len(kinds), axis.num_future_steps + 1)
            samples.append(
                TrafficSample(
                    ids=(
                        *request.agent_ids,
                        *(f"new-{i + 1}" for i in range(len(new))),
                    ),
                    kinds=kinds,
                    size_m=np.full((len(kinds), 2), 2.0),
                    position_m=np.broadcast_to(state[:, None], (*shape, 2)).copy(),
                    heading_rad=np.zeros(shape),
                    velocity_mps=np.zeros((*shape, 2)),
                )
            )
        return GeneratedTraffic(
            samples=tuple(samples), generator=self.name, seed=request.seed
        )
