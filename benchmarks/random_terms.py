"""Runs with random terms on pairs of agents of recorded scenes: is each term reported?

Terms name agents of any kind and state: parked, locked, late, ending early, generated or
kept, and gone. Counts reports with as many lines as terms, lines per state of the other
agent, and how often a threat of the list of possible encounters is met if its agent alone
is generated. Reads both splits under PD_EDITOR_AV2.
"""

import argparse
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.possible_encounters import (
    endangered_id,
    possible_encounters,
)
from pd_editor.analysis.threats.encounter import Approach
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.guidance_terms import GuidanceTerm, TermOutcome
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

APPROACHES: tuple[Approach, ...] = Approach.__args__  # type: ignore[attr-defined]


def state_of(scenario: Scenario, name: str, generated: tuple[str, ...]) -> str:
    """What becomes of an agent in a run."""
    agents, now = scenario.agents, scenario.current_step
    row = agents.row_of.get(name)
    if row is None:
        return "gone"
    if not agents.is_valid[row, now]:
        return "late" if agents.is_valid[row, now:].any() else "past"
    if name in generated:
        return "generated"
    return "kept" if agents.is_valid[row, now:].all() else "ends early"


def random_terms(
    scenario: Scenario, random: np.random.Generator
) -> tuple[GuidanceTerm, ...]:
    """Four terms on pairs of any agents."""
    agents, now = scenario.agents, scenario.current_step
    there = [agents.ids[row] for row in np.flatnonzero(agents.is_valid[:, now])]
    found: list[GuidanceTerm] = []
    for _ in range(4):
        one = str(random.choice(there))
        pool = there if random.random() < 0.7 else [*agents.ids, "gone"]
        other = str(random.choice([name for name in pool if name != one]))
        if random.random() < 0.3:
            found.append(YieldTo(agent_id=one, other_id=other))
        else:
            found.append(
                Threaten(
                    agent_id=one,
                    other_id=other,
                    severity=float(random.choice([0.0, 0.5, 1.0])),
                    approach=APPROACHES[random.integers(len(APPROACHES))],
                )
            )
    return tuple(found)


def outcomes(
    scenario: Scenario, ids: tuple[str, ...], terms: tuple[GuidanceTerm, ...], seed: int
) -> tuple[TermOutcome, ...]:
    """The report of one sample."""
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        guidance=terms,
        num_denoising_steps=6,
        reports_cost=False,
        seed=seed,
    )
    traffic = run_to_end(make_generator(DEFAULT_GENERATOR).generate(request))
    return traffic.guidance[0].outcomes


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = sorted({f.parent for f in root.glob("[tv]*a*/*/scenario_*.parquet")})
    whole = lines = 0
    states: Counter[tuple[str, str]] = Counter()
    listed: Counter[tuple[str, bool]] = Counter()
    for run in range(options.runs):
        random = np.random.default_rng((options.seed, run))
        scenario = read_scenario(folders[int(random.integers(len(folders)))])
        movable = drivable_agent_ids(scenario)
        if run % 3 == 0:
            target = endangered_id(scenario)
            assert target is not None
            threats = [
                one.term
                for one in possible_encounters(scenario, target)
                if isinstance(one.term, Threaten)
            ]
            if threats:
                term = threats[int(random.integers(len(threats)))]
                (found,) = outcomes(scenario, (term.agent_id,), (term,), run)
                listed[term.approach, found.is_obeyed] += 1
                if not found.is_obeyed:
                    print(scenario.scenario_id, term, found.achieved, flush=True)
                whole, lines = whole + 1, lines + 1
                states["kept or ends early", "run"] += 1
                continue
        terms = random_terms(scenario, random)
        named = [one.guided_ids[0] for one in terms if random.random() < 0.8]
        ids = tuple(dict.fromkeys(name for name in named if name in movable))
        if random.random() < 0.2:
            locked = dict.fromkeys(ids[:1], TRAJECTORY_LOCK)
            scenario, ids = replace(scenario, locks=locked), ids[1:]
        if not ids:
            ids = tuple(movable[:1])
        found = outcomes(scenario, ids, terms, run)
        whole += tuple(one.term for one in found) == terms
        lines += len(found)
        for one in found:
            states[
                state_of(scenario, one.term.named_ids[1], ids),
                "run" if one.is_run else "not run, and told",
            ] += 1
    print(f"{options.runs} runs, {whole} with one line for each term, {lines} lines")
    for (state, what), count in sorted(states.items()):
        print(f"  other agent {state}: {what} {count}")
    print("Listed threats, of agents that are generated alone, that are met:")
    for approach in APPROACHES:
        met, not_met = listed[approach, True], listed[approach, False]
        print(f"  {approach}: {met} of {met + not_met}")


if __name__ == "__main__":
    main()
