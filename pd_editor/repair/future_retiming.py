"""Re-timing futures so that curves can be driven and nobody is run into."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.geometry.angles import unit_vector
from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION
from pd_editor.repair.futures import Futures
from pd_editor.repair.report import (
    RepairChange,
    RepairProblem,
    RepairReport,
    name_of,
    repairable,
    sentence,
)
from pd_editor.repair.waiting_plan import blocked_places, waiting_distances
from pd_editor.scene.scenario import Scenario

_MAX_ROUNDS: Final = 8


def retime_futures(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
    friction_coefficient: float = DRY_ROAD_FRICTION,
) -> tuple[Scenario, RepairReport]:
    """Lane followers slowed along their own paths, never ahead of their old timing.

    Speeds keep v <= sqrt(mu g / kappa), with braking ahead of curves; who would run
    into another agent brakes and waits until its path is free. Places and headings at
    the current step stay; a current speed is lowered where a curve is too near. A
    change that would make others overlap is left out; pairs that still run into each
    other are named. ``agent_ids`` None means all; ``keep_ids`` None keeps the focal
    agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    futures = Futures(
        scenario=scenario,
        friction_coefficient=friction_coefficient,
        may_change=repairable(scenario, agent_ids, keep_ids),
    )
    # What one round moves may call for another one; the result calls for none.
    for _ in range(_MAX_ROUNDS):
        after = _one_round(futures)
        if after is futures:
            break
        futures = after
    return futures.scenario, RepairReport(
        changes=_changes(scenario, futures), problems=_problems(futures)
    )


def wait_for_others(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
) -> tuple[Scenario, tuple[str, ...]]:
    """Lane followers who would run into somebody brake and wait, the others as before.

    The part of ``retime_futures`` that is about other agents, in one round: who is too
    fast for a curve stays so.

    Returns:
        The scene, and the ids of those who wait, sorted.

    Raises:
        EditError: an id is not in the scenario.
    """
    futures = Futures(
        scenario=scenario,
        friction_coefficient=DRY_ROAD_FRICTION,
        may_change=repairable(scenario, agent_ids, keep_ids),
    )
    resolved = _resolved(futures)
    names = sorted(scenario.agents.ids[row] for row in resolved.reasons)
    return resolved.scenario, tuple(names)


def _one_round(futures: Futures) -> Futures:
    """Friction, then conflicts; without the friction step where it makes overlaps."""
    pairs, _, total = futures.conflicts()
    slowed = _resolved(futures.slowed_to_friction())
    new_pairs, _, new_total = slowed.conflicts()
    if len(new_pairs) <= len(pairs) and new_total <= total:
        return slowed
    return _resolved(futures)


def _resolved(futures: Futures) -> Futures:
    """The best state found while those who run into others wait, one after another."""
    pairs, steps, total = futures.conflicts()
    best, best_count, most = futures, len(pairs), total
    tried: set[tuple[int, int]] = set()
    while len(pairs):
        after = None
        for (one, two), step in zip(pairs.tolist(), steps.tolist(), strict=True):
            for row, other in _who_waits(futures, one, two, step):
                if (row, other) in tried or not futures.may_change[row]:
                    continue
                tried.add((row, other))
                after = _waiting(futures, row, other, len(pairs))
                if after is not None:
                    break
            if after is not None:
                break
        if after is None:
            return best
        futures = after
        pairs, steps, total = futures.conflicts()
        if len(pairs) < best_count and total <= most:
            best, best_count = futures, len(pairs)
    return best


def _who_waits(
    futures: Futures, one: int, two: int, step: int
) -> list[tuple[int, int]]:
    """Both orders of a pair; the one with the other more in front of it comes first."""
    position = futures.agents.position_m[:, step]
    forward = unit_vector(futures.agents.heading_rad[:, step])
    ahead_of_one = float(forward[one] @ (position[two] - position[one]))
    ahead_of_two = float(forward[two] @ (position[one] - position[two]))
    if ahead_of_one > ahead_of_two:
        return [(one, two), (two, one)]
    return [(two, one), (one, two)]


def _waiting(
    futures: Futures, row: int, other: int, max_conflicts: int
) -> Futures | None:
    """The scene with one agent behind another; None if that does not help."""
    path = futures.own_path(row)
    if path.along_m[-1] <= 0:
        return None
    blocked = blocked_places(path, futures.others(row))
    step_s = futures.scenario.time_axis.step_s
    pair = sorted((row, other))
    for distance, speed in waiting_distances(path, blocked, step_s):
        after = futures.retimed(
            np.array([row]),
            distance[None],
            speed[None],
            f"behind {name_of(futures.agents, other)}",
        )
        pairs, _, _ = after.conflicts()
        if len(pairs) <= max_conflicts and pair not in pairs.tolist():
            return after
    return None


def _changes(scenario: Scenario, futures: Futures) -> tuple[RepairChange, ...]:
    before, after, step = scenario.agents, futures.agents, scenario.current_step
    there = before.is_valid[:, step:]
    slower = (before.speed_mps() - after.speed_mps())[:, step:]
    slower = np.max(np.where(there, slower, 0.0), axis=1, initial=0.0)
    last = there.shape[1] - 1 - there[:, ::-1].argmax(axis=1) + step
    changes = []
    for row in sorted(futures.reasons):
        gap = before.position_m[row, last[row]] - after.position_m[row, last[row]]
        shift = float(np.hypot(*gap))
        changes.append(
            RepairChange(
                repair="retime-futures",
                agent_id=before.ids[row],
                shift_m=shift,
                turn_deg=0.0,
                slowdown_mps=float(slower[row]),
                message=sentence(
                    f"{name_of(before, row)} is up to {slower[row]:.1f} m/s slower and "
                    f"ends {shift:.1f} m from where it did, "
                    + " and ".join(futures.reasons[row])
                ),
            )
        )
    return tuple(changes)


def _problems(futures: Futures) -> tuple[RepairProblem, ...]:
    agents, now = futures.agents, futures.scenario.current_step
    pairs, steps, _ = futures.conflicts()
    problems = [
        RepairProblem(
            repair="retime-futures",
            agent_ids=(agents.ids[one], agents.ids[two]),
            message=sentence(
                f"{name_of(agents, one)} and {name_of(agents, two)} still run into "
                f"each other in {(step - now) * futures.scenario.time_axis.step_s:.1f} s"
            ),
        )
        for (one, two), step in zip(pairs.tolist(), steps.tolist(), strict=True)
        if futures.may_change[[one, two]].any()
    ]
    too_fast = replace(futures, reasons={}).slowed_to_friction().reasons
    problems += [
        RepairProblem(
            repair="retime-futures",
            agent_ids=(agents.ids[row],),
            message=sentence(
                f"{name_of(agents, row)} is too fast for its curve, and slower it "
                "would overlap others"
            ),
        )
        for row in too_fast
    ]
    return tuple(problems)
