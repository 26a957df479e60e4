"""Several samples of resampled traffic: one batch against one after another; their cards.

The initial states and trajectories of all agents are resampled by the default weights.
Tells the processor time of a sample, how far samples of a batch are from those made
alone, and the processor time of the cards (numbers and pictures) of all samples. Reads
the val folder under PD_EDITOR_AV2. Give scenarios to use others, and ``--samples N``.
"""

import sys
import time

import numpy as np
import torch

from benchmarks.candidates import full_scenarios
from pd_editor.editor.commands import traffic_command
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.generation import path_diffuser
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.generation import GeneratedTraffic, GenerationRequest, run_to_end
from pd_editor.scene.roles.traffic_choice import replaceable_agent_ids
from pd_editor.viewer.generation.sample_strip import SampleCards, SampleSet

NUM_SCENARIOS = 12
NUM_SAMPLES = 8
SAME_M = 1e-3


def spent(request: GenerationRequest, together: int) -> tuple[float, GeneratedTraffic]:
    """Processor time and samples, ``together`` of which are placed in one batch."""
    usual = path_diffuser._MOST_PLACED_TOGETHER
    path_diffuser._MOST_PLACED_TOGETHER = together
    try:
        began = time.process_time()
        traffic = run_to_end(make_generator(DEFAULT_GENERATOR).generate(request))
        return time.process_time() - began, traffic
    finally:
        path_diffuser._MOST_PLACED_TOGETHER = usual


def main() -> None:
    """Print a line per scenario, then the medians."""
    torch.set_num_threads(1)
    arguments, count = sys.argv[1:], NUM_SAMPLES
    if "--samples" in arguments:
        at = arguments.index("--samples")
        count = int(arguments[at + 1])
        del arguments[at : at + 2]
    scenarios = [open_scenario(one) for one in arguments]
    scenarios = scenarios or full_scenarios("val")[:NUM_SCENARIOS]
    print(f"{'scenario':38s} agents  alone s  batch s  ratio  apart m  same  cards ms")
    rows: list[tuple[float, ...]] = []
    for number, scenario in enumerate(scenarios):
        ids = replaceable_agent_ids(scenario, keeps_ego=True, keeps_focal=True)
        request = GenerationRequest(
            scenario=scenario,
            agent_ids=ids,
            resampled_state_ids=ids,
            only_on_road=True,
            num_samples=count,
            seed=1,
        )
        if not number:
            spent(request, count)
        alone_s, alone = spent(request, 1)
        batch_s, batch = spent(request, count)
        apart = [
            float(np.abs(one.position_m - two.position_m).max())
            for one, two in zip(alone.samples, batch.samples, strict=True)
        ]
        samples = SampleSet(
            before=scenario,
            base=scenario,
            done=(),
            samples=batch.samples,
            commands=tuple(
                traffic_command(request, batch, index) for index in range(count)
            ),
        )
        began = time.process_time()
        SampleCards.of(samples)
        cards_ms = 1e3 * (time.process_time() - began)
        same = float(np.mean(np.array(apart) < SAME_M))
        rows.append((alone_s, batch_s, alone_s / batch_s, max(apart), same, cards_ms))
        print(
            f"{scenario.scenario_id:38s} {len(ids):6d} {alone_s:8.2f} {batch_s:8.2f} "
            f"{alone_s / batch_s:6.2f} {max(apart):8.4f} {same:5.2f} {cards_ms:9.0f}",
            flush=True,
        )
    table = np.array(rows)
    middle = np.median(table, axis=0)
    print(
        f"{'median':45s} {middle[0]:8.2f} {middle[1]:8.2f} {middle[2]:6.2f} "
        f"{middle[3]:8.4f} {middle[4]:5.2f} {middle[5]:9.0f}"
    )
    low, high = np.quantile(table[:, 2], [0.1, 0.9])
    print(f"ratios from {low:.2f} to {high:.2f} (10th and 90th percentile)")


if __name__ == "__main__":
    main()
