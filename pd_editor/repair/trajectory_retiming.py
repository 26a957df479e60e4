"""Retimes trajectories so that they keep the friction limit and do not collide."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION
from pd_editor.repair.repair_report import (
    RepairChange,
    RepairKind,
    RepairProblem,
    RepairReport,
    name_of,
    repairable,
    sentence,
)
from pd_editor.repair.trajectories import Trajectories
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.scenario import Scenario

_MAX_ROUNDS: Final = 8


def retime_trajectories(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
    friction_coefficient: float = DRY_ROAD_FRICTION,
) -> tuple[Scenario, RepairReport]:
    """Slow lane followers along their own paths; they never run ahead of their timing.

    Speeds keep v <= sqrt(mu g / kappa), with braking ahead of curves; agents that
    would collide yield. Current poses stay; a current speed is lowered if a curve is
    too near. Changes that would cause other overlaps are left out; pairs that still
    collide are reported. ``agent_ids`` None means all; ``keep_ids`` None keeps the
    focal agent.

    Raises:
        EditError: an id is not in the scenario.
    """
    trajectories = Trajectories(
        scenario=scenario,
        friction_coefficient=friction_coefficient,
        may_change=repairable(scenario, agent_ids, keep_ids),
    )
    # One round may cause new conflicts; the result has none that a round resolves.
    for _ in range(_MAX_ROUNDS):
        after = _one_round(trajectories)
        if after is trajectories:
            break
        trajectories = after
    return trajectories.scenario, RepairReport(
        changes=changes_of(scenario, trajectories, "retime-trajectories"),
        problems=_problems(trajectories),
    )


def yield_to_others(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
    last_ids: Collection[str] = (),
) -> tuple[Scenario, tuple[str, ...]]:
    """Let road users yield that would collide; all others are unchanged.

    Agents whose trajectory is locked never yield, and those with locked first seconds
    only later. These and agents with ``last_ids`` yield only if the other one cannot.

    One round of ``retime_trajectories`` without the friction limit.

    Returns:
        The scene, and the sorted ids of the agents that were slowed.

    Raises:
        EditError: an id is not in the scenario.
    """
    trajectories = Trajectories(
        scenario=scenario,
        friction_coefficient=DRY_ROAD_FRICTION,
        may_change=repairable(
            scenario, agent_ids, keep_ids, ROAD_USER_KINDS, keeps_beginnings=True
        ),
    )
    resolved = trajectories.with_yielding(last_ids)
    names = sorted(scenario.agents.ids[row] for row in resolved.reasons)
    return resolved.scenario, tuple(names)


def _one_round(trajectories: Trajectories) -> Trajectories:
    """Apply the friction limit, then yielding; without the former if it adds overlaps."""
    pairs, _, total = trajectories.conflicts()
    slowed = trajectories.slowed_to_friction().with_yielding()
    new_pairs, _, new_total = slowed.conflicts()
    if len(new_pairs) <= len(pairs) and new_total <= total:
        return slowed
    return trajectories.with_yielding()


def changes_of(
    scenario: Scenario, trajectories: Trajectories, repair: RepairKind
) -> tuple[RepairChange, ...]:
    """Changes of all retimed agents, in a sentence each."""
    before, after, step = scenario.agents, trajectories.agents, scenario.current_step
    there = before.is_valid[:, step:]
    slower = (before.speed_mps() - after.speed_mps())[:, step:]
    slower = np.max(np.where(there, slower, 0.0), axis=1, initial=0.0)
    last = there.shape[1] - 1 - there[:, ::-1].argmax(axis=1) + step
    changes = []
    for row in sorted(trajectories.reasons):
        gap = before.position_m[row, last[row]] - after.position_m[row, last[row]]
        shift = float(np.hypot(*gap))
        changes.append(
            RepairChange(
                repair=repair,
                agent_id=before.ids[row],
                shift_m=shift,
                turn_deg=0.0,
                slowdown_mps=float(slower[row]),
                message=sentence(
                    f"{name_of(before, row)} is up to {slower[row]:.1f} m/s slower and "
                    f"ends {shift:.1f} m from where it did, "
                    + " and ".join(trajectories.reasons[row])
                ),
            )
        )
    return tuple(changes)


def _problems(trajectories: Trajectories) -> tuple[RepairProblem, ...]:
    agents, now = trajectories.agents, trajectories.scenario.current_step
    pairs, steps, _ = trajectories.conflicts()
    problems = [
        RepairProblem(
            repair="retime-trajectories",
            agent_ids=(agents.ids[one], agents.ids[two]),
            message=sentence(
                f"{name_of(agents, one)} and {name_of(agents, two)} still run into "
                f"each other in {(step - now) * trajectories.scenario.time_axis.step_s:.1f} s"
            ),
        )
        for (one, two), step in zip(pairs.tolist(), steps.tolist(), strict=True)
        if trajectories.may_change[[one, two]].any()
    ]
    too_fast = replace(trajectories, reasons={}).slowed_to_friction().reasons
    problems += [
        RepairProblem(
            repair="retime-trajectories",
            agent_ids=(agents.ids[row],),
            message=sentence(
                f"{name_of(agents, row)} is too fast for its curve, and slower it "
                "would overlap others"
            ),
        )
        for row in too_fast
    ]
    return tuple(problems)
