"""What each placement rule brings: agents that break it, recorded, raw and with the rules.

All road users near lanes are resampled, once without any rule, once with all, and once for
each rule without it. A column of the table is a rule; a cell is the share of agents that
break it, in percent. Raw comes first: what a rule forces is no figure of the model.
Needs PD_EDITOR_AV2.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.placement_rules import (
    PLACEMENT_RULES,
    ConflictResampling,
    ConflictSearch,
    KeptPaths,
    PlacementRule,
)
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.scenario import Scenario


def breaking(scenario: Scenario) -> np.ndarray:
    """Number of agents that break each rule, and of all that rules are for."""
    agents, step = scenario.agents, scenario.current_step
    counts = agents.is_valid[:, step] & agents.kind_mask(LANE_FOLLOWER_KINDS)
    rows = np.flatnonzero(counts)
    traffic = ConflictSearch.of(ConflictResampling(), InitialStateGuidance()).traffic(
        agents.taken(rows), scenario, KeptPaths.of(scenario, agents.ids)
    )
    found = [one.offenders(traffic) for one in PLACEMENT_RULES]
    return np.array([*((one | one.T).any(axis=1).sum() for one in found), counts.sum()])


def resampled(
    model: Path,
    rules: Sequence[PlacementRule],
    scenarios: Sequence[Scenario],
    seed: int,
) -> np.ndarray:
    """The same, summed over scenes with all road users resampled under some rules."""
    generator = PathDiffuser(model, placement_rules=rules)
    total = np.zeros(len(PLACEMENT_RULES) + 1, int)
    for scenario in scenarios:
        agents, step = scenario.agents, scenario.current_step
        is_there = agents.is_valid[:, step] & agents.kind_mask(ROAD_USER_KINDS)
        ids = tuple(agents.ids[row] for row in np.flatnonzero(is_there))
        request = GenerationRequest(
            scenario=scenario, agent_ids=ids, resampled_state_ids=ids, seed=seed
        )
        (sample,) = run_to_end(generator.generate(request)).samples
        rows = agents.rows(sample.ids)
        states = {
            name: getattr(agents, name).copy()
            for name in ("position_m", "heading_rad", "velocity_mps")
        }
        for name, values in states.items():
            values[rows, step] = getattr(sample, name)[:, 0]
        total += breaking(
            scenario.with_agents(agents.with_rows(np.arange(len(agents)), **states))
        )
    return total


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", type=Path, default=Path("models/path-diffuser"))
    parser.add_argument("--split", default="val")
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"]) / options.split
    scenarios = [read_scenario(one) for one in sorted(root.glob("*/"))]
    print(" " * 22 + "".join(f"{one.name:>16}" for one in PLACEMENT_RULES))

    def line(name: str, total: np.ndarray) -> None:
        shares = 100 * total[:-1] / total[-1]
        print(f"{name:22}" + "".join(f"{one:16.1f}" for one in shares), flush=True)

    line("recorded", np.sum([breaking(one) for one in scenarios], axis=0))
    choices = {"without any": (), "all rules": PLACEMENT_RULES} | {
        f"but {left_out.name}": [one for one in PLACEMENT_RULES if one is not left_out]
        for left_out in PLACEMENT_RULES
    }
    for name, rules in choices.items():
        seeds = range(options.seeds)
        found = [resampled(options.model, rules, scenarios, seed) for seed in seeds]
        line(name, np.sum(found, axis=0))


if __name__ == "__main__":
    main()
