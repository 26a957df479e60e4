"""The lane follower as a ``ScenarioGenerator``."""

import time
from collections.abc import Generator, Iterator

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.base.errors import GenerationError
from pd_editor.generation.lane_follower.simulated_traffic import (
    Drivers,
    drivers_at,
    initial_traffic,
    sample_intentions,
    simulate,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_states import MOTION
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    TrafficSample,
)
from pd_editor.scene.thresholds import MOVING_MPS


class LaneFollower:
    """Generator in which drivers follow lane routes, keep their gaps and yield.

    Pedestrians and static objects keep their velocity. It places no new agents.
    """

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        return "lane-follower"

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress, return the traffic.

        Raises:
            GenerationError: new agents are asked for, or the request is no good.
            EditError: an agent is not in the scenario.
        """
        began = time.perf_counter()
        rows = _checked_rows(request)
        scenario = request.scenario
        asked = np.zeros(len(scenario.agents), bool)
        asked[rows] = True
        drives = asked & scenario.agents.kind_mask(LANE_FOLLOWER_KINDS)
        drivers = drivers_at(scenario, np.flatnonzero(drives))
        initial = initial_traffic(scenario, asked)
        samples: list[TrafficSample] = []
        for index in range(request.num_samples):
            random = np.random.default_rng([request.scene_seed, index])
            wants = sample_intentions(drivers, len(scenario.agents), random)
            traffic = initial.copy()
            steps = simulate(traffic, drivers, wants, scenario.time_axis)
            yield from _reports(steps, index, request)
            motion = (getattr(traffic, name)[rows] for name in MOTION)
            samples.append(TrafficSample.of(scenario.agents.taken(rows), motion))
        return GeneratedTraffic(
            samples=tuple(samples),
            generator=self.name,
            seed=request.seed,
            elapsed_s=time.perf_counter() - began,
            notes=_notes(request, drivers),
        )


def _checked_rows(request: GenerationRequest) -> Int[np.ndarray, "G"]:
    if request.samples_states:
        raise GenerationError(
            "The lane follower cannot place new agents; place them by hand, or choose "
            "a learned model."
        )
    locks = request.scenario.locks
    for name in request.agent_ids:
        if name in locks and locks[name].keeps_beginning:
            raise GenerationError(
                f"The {locks[name].in_words} of agent {name} is locked, which the lane "
                "follower cannot go on from; lock the whole trajectory, or choose a "
                "learned model."
            )
    if len(set(request.agent_ids)) < len(request.agent_ids):
        raise GenerationError("An agent was requested twice; each may be named once.")
    agents = request.scenario.agents
    rows = agents.rows(request.agent_ids)
    exists: Bool[np.ndarray, "G"] = agents.is_valid[rows, request.scenario.current_step]
    if not exists.all():
        missing = request.agent_ids[int(np.argmin(exists))]
        raise GenerationError(
            f"Agent {missing} is not there at the current step, so it has no state to "
            "go on from."
        )
    return rows


def _reports(
    steps: Iterator[int], sample: int, request: GenerationRequest
) -> Iterator[GenerationProgress]:
    total = max(request.scenario.time_axis.num_future_steps, 1)
    for step in steps:
        if step % 10 == 0:
            yield GenerationProgress(
                fraction=(sample + step / total) / request.num_samples,
                message=f"Sample {sample + 1} of {request.num_samples}",
            )


def _notes(request: GenerationRequest, drivers: Drivers) -> tuple[str, ...]:
    notes: list[str] = []
    off_lane = np.setdiff1d(np.arange(len(drivers.kinds)), drivers.choice.agent)
    off_lane = off_lane[drivers.speed_mps[off_lane] > MOVING_MPS]
    if len(off_lane):
        ids = ", ".join(
            request.scenario.agents.ids[row] for row in drivers.row[off_lane]
        )
        notes.append(f"No lane near agents {ids}; they go straight on.")
    if request.guidance or request.terms:
        notes.append("The lane follower takes no guidance.")
    return tuple(notes)
