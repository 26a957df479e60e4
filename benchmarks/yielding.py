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
from pd_editor.analysis.metrics.box_overlaps import first_overlap, overlapping_pairs
from pd_editor.analysis.repair.current_states import counted
from pd_editor.editor.commands import ReplaceTraffic, RequestSummary
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.generation.trajectory.sample_yielding import with_yielding
from pd_editor.scene.generation import (
    GenerationRequest,
    TrafficSample,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

STACKED = (32, 64, 128, 256)
REPEATS = 5


def sampled(scenario: Scenario, count: int) -> Iterator[TrafficSample]:
    """Trajectories of all agents as the network samples them."""
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=drivable_agent_ids(scenario, None),
        num_samples=count,
        guidance=guidance_settings(None, 0),
    )
    yield from run_to_end(make_generator(DEFAULT_GENERATOR).generate(request)).samples


def num_conflicts(scenario: Scenario, sample: TrafficSample) -> int:
    """Pairs that collide later, and do not overlap now, of which one is sampled."""
    command = ReplaceTraffic(
        sample=sample,
        generator="sampled",
        request=RequestSummary(agent_ids=sample.ids),
    )
    agents, now = command.apply(scenario).agents, scenario.current_step
    rows = agents.rows(sample.ids)
    later, _ = first_overlap(agents, np.arange(now + 1, agents.num_steps))
    is_evaluated = np.isin(later, rows).any(axis=1) & counted(agents, later)
    later = later[is_evaluated & agents.is_valid[later, now].all(axis=1)]
    already = {tuple(pair) for pair in overlapping_pairs(agents, now).tolist()}
    return len({tuple(pair) for pair in later.tolist()} - already)


def told(name: str, scenarios: list[Scenario], count: int) -> None:
    """Print slowed agents and milliseconds of some scenes."""
    spent: list[float] = []
    slowed = agents = before = after = 0
    for scenario in scenarios:
        rows = scenario.agents.rows(drivable_agent_ids(scenario, None))
        for sample in sampled(scenario, count):
            times, ids, yielded = [], (), sample
            for _ in range(REPEATS):
                began = time.process_time()
                yielded, ids = with_yielding(scenario, rows, sample)
                times.append(1e3 * (time.process_time() - began))
            spent.append(min(times))
            before += num_conflicts(scenario, sample)
            after += num_conflicts(scenario, yielded)
            slowed, agents = slowed + len(ids), agents + len(rows)
    print(
        f"{name:24s} {agents:7d} {before:7d} {after:7d} {slowed:7d} {np.median(spent):9.2f} {max(spent):9.2f}"
    )


def main() -> None:
    """Print a table."""
    torch.set_num_threads(1)
    scenarios = full_scenarios()
    print(
        f"{'scenes':24s} {'agents':>7s} {'before':>7s} {'after':>7s} "
        f"{'slowed':>7s} {'median ms':>9s} {'most':>9s}"
    )
    told(f"{len(scenarios)} real", scenarios, 2)
    busiest = max(scenarios, key=lambda one: len(movers_now(one, 0.5)))
    for count in STACKED:
        told(f"{count} stacked", [crowd(busiest, count)], 2)


if __name__ == "__main__":
    main()
