"""Yielding in sampled traffic: collisions before and after, slowed agents, time.

Scenes are the recorded ones with all trajectories sampled by the default weights, and
up to 256 moving agents stacked on the places of a few. Times are of the processor, on
one thread. Reads the train and val folders under PD_EDITOR_AV2.
"""

import time
from collections.abc import Iterator

import numpy as np
import torch

from benchmarks.candidates import crowd, full_scenarios, movers_now
from pd_editor.diffusion.trajectory.yielding import with_yielding
from pd_editor.generation import (
    GenerationRequest,
    TrafficSample,
    guidance_terms,
    run_to_end,
)
from pd_editor.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_choice import drivable_agent_ids

STACKED = (32, 64, 128, 256)
REPEATS = 5


def sampled(scenario: Scenario, count: int) -> Iterator[TrafficSample]:
    """Trajectories of all agents as the network samples them."""
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=drivable_agent_ids(scenario, None),
        num_samples=count,
        guidance=guidance_terms(None, 0),
    )
    yield from run_to_end(make_generator(DEFAULT_GENERATOR).generate(request)).samples


def told(name: str, scenarios: list[Scenario], count: int) -> None:
    """Print slowed agents and milliseconds of some scenes."""
    spent: list[float] = []
    slowed = agents = 0
    for scenario in scenarios:
        rows = scenario.agents.rows(drivable_agent_ids(scenario, None))
        for sample in sampled(scenario, count):
            times, ids = [], ()
            for _ in range(REPEATS):
                began = time.process_time()
                _, ids = with_yielding(scenario, rows, sample)
                times.append(1e3 * (time.process_time() - began))
            spent.append(min(times))
            slowed, agents = slowed + len(ids), agents + len(rows)
    print(
        f"{name:24s} {agents:7d} {slowed:7d} {np.median(spent):9.2f} {max(spent):9.2f}"
    )


def main() -> None:
    """Print a table."""
    torch.set_num_threads(1)
    scenarios = full_scenarios()
    print(
        f"{'scenes':24s} {'agents':>7s} {'slowed':>7s} {'median ms':>9s} {'most':>9s}"
    )
    told(f"{len(scenarios)} real", scenarios, 2)
    busiest = max(scenarios, key=lambda one: len(movers_now(one, 0.5)))
    for count in STACKED:
        told(f"{count} stacked", [crowd(busiest, count)], 2)


if __name__ == "__main__":
    main()
