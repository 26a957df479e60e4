"""Reference methods: the log, and four simple baselines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.metrics.traffic_view import (
    TrafficView,
    generated_traffic,
    recorded_traffic,
)
from pd_editor.scene.generation import GenerationRequest, TrafficSample
from pd_editor.scene.paths.motion_primitives import CandidateSet, candidates

GROUND_TRUTH: Final = "ground-truth"
"""Name of the method that all others are compared with."""
_FAR_M: Final = 1e9


@dataclass(frozen=True, kw_only=True)
class ReferenceMethod:
    """A method without a generator."""

    name: str
    description: str
    traffic: Callable[[GenerationRequest], tuple[TrafficView, ...]]
    """Function that makes one view per sample; deterministic methods give one view."""


def _ground_truth(request: GenerationRequest) -> tuple[TrafficView, ...]:
    return (recorded_traffic(request.scenario, request.agent_ids),)


def _constant_velocity(request: GenerationRequest) -> tuple[TrafficView, ...]:
    agents, axis = request.scenario.agents, request.scenario.time_axis
    rows, step = agents.rows(request.agent_ids), axis.current_step
    time = axis.times_s()[step:, None]
    velocity = np.repeat(agents.velocity_mps[rows, step, None], len(time), axis=1)
    position = agents.position_m[rows, step, None] + time * velocity
    heading = np.repeat(agents.heading_rad[rows, step, None], len(time), axis=1)
    return (_view(request, position, heading, velocity),)


def _random_candidate(request: GenerationRequest) -> tuple[TrafficView, ...]:
    scenario = request.scenario
    rows = scenario.agents.rows(request.agent_ids)
    found = candidates(scenario, rows)
    count = found.is_valid.sum(axis=1)
    views = []
    for sample in range(request.num_samples):
        random = np.random.default_rng([request.scene_seed, sample])
        # Sampled for all agents, so that it does not depend on the requested agents.
        pick = random.random(len(scenario.agents))[rows]
        views.append(_chosen(request, found, (pick * count).astype(int)))
    return tuple(views)


def _best_candidate(request: GenerationRequest) -> tuple[TrafficView, ...]:
    scenario = request.scenario
    rows = scenario.agents.rows(request.agent_ids)
    found = candidates(scenario, rows)
    later = slice(scenario.current_step + 1, None)
    logged = scenario.agents.position_m[rows, later]
    is_known = scenario.agents.is_valid[rows, later]
    offset = found.position_m[:, :, 1:] - logged[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    mean = np.where(is_known[:, None], distance, 0.0).sum(axis=2)
    mean = np.where(found.is_valid, mean, _FAR_M)
    return (_chosen(request, found, mean.argmin(axis=1)),)


def _chosen(
    request: GenerationRequest, found: CandidateSet, choice: Int[np.ndarray, "A"]
) -> TrafficView:
    agent = np.arange(len(choice))
    return _view(
        request,
        found.position_m[agent, choice],
        found.heading_rad[agent, choice],
        found.velocity_mps[agent, choice],
    )


def _view(
    request: GenerationRequest,
    position_m: Float[np.ndarray, "A H 2"],
    heading_rad: Float[np.ndarray, "A H"],
    velocity_mps: Float[np.ndarray, "A H 2"],
) -> TrafficView:
    agents = request.scenario.agents
    motion = (position_m, heading_rad, velocity_mps)
    sample = TrafficSample.of(agents.taken(agents.rows(request.agent_ids)), motion)
    return generated_traffic(request.scenario, sample)


_ALL: Final = (
    ReferenceMethod(
        name=GROUND_TRUTH,
        description="The log. An agent counts while it is recorded.",
        traffic=_ground_truth,
    ),
    ReferenceMethod(
        name="constant-velocity",
        description="Every agent keeps its velocity.",
        traffic=_constant_velocity,
    ),
    ReferenceMethod(
        name="random-candidate",
        description="Every agent takes one of its Frenet candidates, sampled at random.",
        traffic=_random_candidate,
    ),
    ReferenceMethod(
        name="best-candidate",
        description="ORACLE: every agent takes the candidate nearest to its logged "
        "future, which no generator knows.",
        traffic=_best_candidate,
    ),
)
REFERENCE_METHODS: Final[Mapping[str, ReferenceMethod]] = {
    method.name: method for method in _ALL
}
