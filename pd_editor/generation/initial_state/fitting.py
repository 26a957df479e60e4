"""Which placed agents fit: into the scene's limit, beside others, and out of their way."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from pd_editor.analysis.metrics.box_overlaps import first_overlap, overlapping_pairs
from pd_editor.analysis.repair.current_states import counted
from pd_editor.generation.initial_state.pipeline import SquarePlacement
from pd_editor.generation.initial_state.placement_rules import ConflictSearch, KeptPaths
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario


def limited(
    placings: Sequence[SquarePlacement], most_new: int, random: np.random.Generator
) -> tuple[SquarePlacement, ...]:
    """Placements with at most ``most_new`` new agents, of which any may be left out."""
    number = sum(len(one.new_ids) for one in placings)
    if number <= most_new:
        return tuple(placings)
    stays = np.zeros(number, bool)
    stays[random.permutation(number)[: max(most_new, 0)]] = True
    fewer: list[SquarePlacement] = []
    first = 0
    for one in placings:
        own = np.flatnonzero(stays[first : first + len(one.new_ids)]).tolist()
        first += len(one.new_ids)
        fewer.append(
            replace(
                one,
                new_ids=tuple(one.new_ids[index] for index in own),
                new_kinds=tuple(one.new_kinds[index] for index in own),
            )
        )
    return tuple(one for one in fewer if one.ids)


def num_overlapping(scenario: Scenario, agent_ids: Collection[str]) -> int:
    """Number of some agents whose boxes overlap others at the current step."""
    agents = scenario.agents
    pairs = overlapping_pairs(agents, scenario.current_step)
    pairs = pairs[counted(agents, pairs)]
    return len(np.intersect1d(pairs, agents.rows(agent_ids)))


def without_overlapping(
    scenario: Scenario, new_ids: Sequence[str]
) -> tuple[Scenario, tuple[str, ...]]:
    """Remove new agents whose boxes overlap others, most overlaps first.

    Returns:
        The scenario, and the ids of the new agents that stay.
    """
    agents = scenario.agents
    pairs = overlapping_pairs(agents, scenario.current_step)
    pairs = pairs[counted(agents, pairs)]
    is_new = np.isin(agents.ids, list(new_ids))
    pairs = pairs[is_new[pairs].any(axis=1)]
    gone: list[int] = []
    while len(pairs):
        number = np.bincount(pairs.ravel(), minlength=len(agents)) * is_new
        row = int(np.flatnonzero(number == number.max())[-1])
        gone.append(row)
        pairs = pairs[(pairs != row).all(axis=1)]
    return without_new(scenario, new_ids, {agents.ids[row] for row in gone})


def without_unfit(
    scenario: Scenario,
    new_ids: Sequence[str],
    admits: Callable[[Scenario, Sequence[str]], Sequence[str]],
    conflicts: ConflictSearch | None,
    kept: KeptPaths,
) -> Scenario:
    """Remove new agents that are not admitted, then those that break a placement rule."""
    stays = admits(scenario, new_ids)
    scenario, _ = without_new(scenario, new_ids, set(new_ids).difference(stays))
    if conflicts is None or not stays:
        return scenario
    gone = conflicts.conflicting(scenario, stays, np.random.default_rng(0), kept)
    return without_new(scenario, stays, gone)[0]


def without_new(
    scenario: Scenario, new_ids: Sequence[str], gone: Collection[str]
) -> tuple[Scenario, tuple[str, ...]]:
    """Remove those of the new agents that are in ``gone``; returns as above."""
    names = tuple(name for name in new_ids if name in gone)
    if not names:
        return scenario, tuple(new_ids)
    # Left-out agents were never in the scenario, so their ids are free.
    kept = replace(scenario.without_agents(names), retired_ids=scenario.retired_ids)
    return kept, tuple(name for name in new_ids if name not in names)


def colliding_with_kept(
    scenario: Scenario,
    sample: TrafficSample,
    placed_ids: Sequence[str],
    new_ids: Collection[str] = (),
) -> tuple[str, ...]:
    """Placed agents, new ones among them, that collide with agents with kept states."""
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(sample.ids)
    if not len(rows):
        return ()
    driven = sample.applied_to(agents, rows, now)
    pairs, _ = first_overlap(driven, np.arange(now, agents.num_steps))
    pairs = pairs[counted(driven, pairs)]
    is_placed = np.isin(agents.ids, list(placed_ids))
    # Whatever enters later at an agent's own place may be that agent, tracked again.
    late, old = LateAgents.of(scenario), rows[~np.isin(sample.ids, list(new_ids))]
    is_kept = ~is_placed
    is_kept[np.setdiff1d(late.row, late.but_continuing(old).row)] = False
    both = np.concatenate([pairs, pairs[:, ::-1]])
    hit = both[is_placed[both[:, 0]] & is_kept[both[:, 1]], 0]
    return tuple(agents.ids[row] for row in np.unique(hit))
