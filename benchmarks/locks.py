"""Locks: what is kept is bit-identical, and resampled agents avoid locked and late ones.

On the recorded scenes of the val folder under PD_EDITOR_AV2, several seeds each, with the
default weights and settings. A third of the agents is locked in turn (whole trajectory,
first 2 s, state); the others get new trajectories, then new states as well. Collisions of
the free agents with the locked ones are counted against those with the same agents when
nothing is locked and all are sampled. Collisions with agents that enter the recording
after the current step are counted when all agents get new trajectories. Intervals are
95 % by resampling scenes.
"""

import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.candidates import full_scenarios
from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.repair.current_states import counted
from pd_editor.editor.commands import traffic_command
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.experiments.evaluation.summary import (
    mean_over_scenes,
    scene_weights,
)
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.generation import (
    GenerationRequest,
    ScenarioGenerator,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.roles.traffic_choice import (
    drivable_agent_ids,
    resamplable_agent_ids,
)
from pd_editor.scene.scenario import Scenario

NUM_SEEDS = 3
LOCKS = (TRAJECTORY_LOCK, Lock(kept_s=2.0), STATE_LOCK)
KEPT_FIELDS = ("position_m", "heading_rad", "velocity_mps", "is_valid")


@dataclass(frozen=True, kw_only=True)
class Count:
    """Collisions in one scene, and the agents that could have had them."""

    scene: int
    collisions: int
    agents: int


def generated(
    generator: ScenarioGenerator,
    scenario: Scenario,
    seed: int,
    *,
    with_states: bool,
    is_raw: bool = False,
) -> Scenario:
    """The scenario with sampled trajectories, or also states, of what is not locked."""
    ids = drivable_agent_ids(scenario)
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        resampled_state_ids=resamplable_agent_ids(scenario, ids) if with_states else (),
        only_on_road=with_states,
        guidance=guidance_settings(None, 0) if is_raw else (),
        seed=seed,
    )
    traffic = run_to_end(generator.generate(request))
    return apply_within_locks(traffic_command(request, traffic), scenario)


def num_collisions(
    scenario: Scenario,
    some: Sequence[str],
    others: Sequence[str],
    left_out: Collection[tuple[str, str]] = (),
) -> int:
    """Agents among ``some`` that collide with any of ``others`` after the current step.

    ``left_out`` are pairs that do not count.
    """
    agents, now = scenario.agents, scenario.current_step
    pairs, _ = first_overlap(agents, np.arange(now + 1, agents.num_steps))
    pairs = pairs[counted(agents, pairs)]
    one, two = (np.isin(agents.ids, list(ids)) for ids in (some, others))
    hits = np.concatenate([pairs, pairs[:, ::-1]])
    hits = hits[one[hits[:, 0]] & two[hits[:, 1]]]
    counts = [(agents.ids[a], agents.ids[b]) not in left_out for a, b in hits]
    hits = hits[np.array(counts, bool)]
    return len(np.unique(hits[:, 0]))


def is_bit_identical(before: Scenario, after: Scenario) -> bool:
    """Whether all that is locked has the same bytes."""
    is_kept = before.kept_steps()
    for name in before.locks:
        row, other = before.agents.row_of[name], after.agents.row_of[name]
        steps = is_kept[row]
        for field in KEPT_FIELDS:
            one = getattr(before.agents, field)[row][steps]
            two = getattr(after.agents, field)[other][steps]
            if one.tobytes() != two.tobytes():
                return False
    return True


def told(name: str, counts: Sequence[Count]) -> None:
    """Print a rate per 100 agents with its interval."""
    scenes = sorted({one.scene for one in counts})
    table = np.array(
        [
            [sum(c.collisions for c in counts if c.scene == scene) for scene in scenes],
            [sum(c.agents for c in counts if c.scene == scene) for scene in scenes],
        ],
        float,
    )
    rate = mean_over_scenes(100 * table[0], table[1], scene_weights(len(scenes), 0))
    print(
        f"{name:52s} {int(table[0].sum()):5d} of {int(table[1].sum()):6d}"
        f"  {float(rate.value):5.2f} % ({float(rate.low):.2f} to {float(rate.high):.2f})",
        flush=True,
    )


def late_ids(scenario: Scenario) -> tuple[tuple[str, ...], set[tuple[str, str]]]:
    """Agents that enter later, and pairs of an agent and one of these that do not count.

    Pairs that collide in the recording, and an agent with the one that continues its track.
    """
    agents, late = scenario.agents, LateAgents.of(scenario)
    ids, steps = agents.ids, np.arange(scenario.current_step + 1, agents.num_steps)
    pairs, _ = first_overlap(agents, steps)
    doubles = [(row, late.row[index]) for index, row in np.argwhere(late.continues)]
    every = [*pairs.tolist(), *pairs[:, ::-1].tolist(), *doubles]
    return (
        tuple(ids[row] for row in late.row),
        {(ids[one], ids[two]) for one, two in every},
    )


def late_agents(generator: ScenarioGenerator, scenarios: Sequence[Scenario]) -> None:
    """New collisions with agents that enter later, of all agents at the current step."""
    for is_raw in (True, False):
        counts: list[Count] = []
        for index, scenario in enumerate(scenarios):
            ids, (late, known) = drivable_agent_ids(scenario), late_ids(scenario)
            for seed in range(NUM_SEEDS):
                after = generated(
                    generator, scenario, seed, with_states=False, is_raw=is_raw
                )
                hits = num_collisions(after, ids, late, known)
                counts.append(Count(scene=index, collisions=hits, agents=len(ids)))
        told(f"new ones with late agents, {'raw' if is_raw else 'default'}", counts)


def locked_agents(generator: ScenarioGenerator, scenarios: Sequence[Scenario]) -> None:
    """Collisions of free agents with locked ones, and whether these are bit-identical."""
    for with_states in (False, True):
        what = "states and trajectories" if with_states else "trajectories"
        free_counts: list[Count] = []
        locked_counts: dict[Lock, list[Count]] = {lock: [] for lock in LOCKS}
        num_kept = num_identical = 0
        for index, scenario in enumerate(scenarios):
            ids = np.array(drivable_agent_ids(scenario))
            for seed in range(NUM_SEEDS):
                random = np.random.default_rng([seed, index])
                held = tuple(random.permutation(ids)[: max(len(ids) // 3, 1)].tolist())
                free = tuple(name for name in ids.tolist() if name not in held)
                if not free:
                    continue
                after = generated(generator, scenario, seed, with_states=with_states)
                hits = num_collisions(after, free, held)
                free_counts.append(
                    Count(scene=index, collisions=hits, agents=len(free))
                )
                for lock, counts in locked_counts.items():
                    before = replace(scenario, locks=dict.fromkeys(held, lock))
                    after = generated(generator, before, seed, with_states=with_states)
                    hits = num_collisions(after, free, held)
                    counts.append(Count(scene=index, collisions=hits, agents=len(free)))
                    num_kept += 1
                    num_identical += is_bit_identical(before, after)
        told(f"{what}: nothing locked", free_counts)
        for lock, counts in locked_counts.items():
            told(f"{what}: the {lock.in_words} of a third locked", counts)
        print(f"{what}: bit-identical in {num_identical} of {num_kept} runs")


def main() -> None:
    """Print the rates; scenes are those of ``val``, or of the folder that is named."""
    folder = sys.argv[1] if len(sys.argv) > 1 else "val"
    scenarios = full_scenarios(folder)
    generator = make_generator(DEFAULT_GENERATOR)
    print(f"{len(scenarios)} scenes, {NUM_SEEDS} seeds; agents in collision:")
    late_agents(generator, scenarios)
    if len(sys.argv) < 3:
        locked_agents(generator, scenarios)


if __name__ == "__main__":
    main()
