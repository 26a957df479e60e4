"""Re-timing futures so that curves can be driven and agents do not collide."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION
from pd_editor.repair.repair_report import (
    RepairChange,
    RepairProblem,
    RepairReport,
    name_of,
    repairable,
    sentence,
)
from pd_editor.repair.trajectories import Futures
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
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

    Speeds keep v <= sqrt(mu g / kappa), with braking ahead of curves; agents that
    would collide yield. Places and headings at the current step stay; a current speed
    is lowered where a curve is too near. A change that would make others overlap is
    left out; pairs that still collide are named. ``agent_ids`` None means all;
    ``keep_ids`` None keeps the focal agent.

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
    """Road users that would collide yield, the others go on as before.

    The part of ``retime_futures`` that is about other agents, in one round: agents
    that are too fast for a curve stay so.

    Returns:
        The scene, and the ids of the agents that were slowed, sorted.

    Raises:
        EditError: an id is not in the scenario.
    """
    futures = Futures(
        scenario=scenario,
        friction_coefficient=DRY_ROAD_FRICTION,
        may_change=repairable(scenario, agent_ids, keep_ids, ROAD_USER_KINDS),
    )
    resolved = futures.with_yielding()
    names = sorted(scenario.agents.ids[row] for row in resolved.reasons)
    return resolved.scenario, tuple(names)


def _one_round(futures: Futures) -> Futures:
    """Friction, then conflicts; without the friction step where it makes overlaps."""
    pairs, _, total = futures.conflicts()
    slowed = futures.slowed_to_friction().with_yielding()
    new_pairs, _, new_total = slowed.conflicts()
    if len(new_pairs) <= len(pairs) and new_total <= total:
        return slowed
    return futures.with_yielding()


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
