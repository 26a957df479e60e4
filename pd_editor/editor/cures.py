"""Finds cures of findings: commands that are tried and do help."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final

from pd_editor.analysis.findings.check import scene_findings
from pd_editor.analysis.findings.finding import Finding
from pd_editor.analysis.findings.friction import friction_coefficient_of
from pd_editor.analysis.findings.road import weakened_to_radius
from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.analysis.metrics.road import nearest_on_road
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands.agents import DeleteAgents
from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.guidance import RemoveGuidance
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.commands.motion import (
    SlowToComfort,
    SlowToFrictionLimit,
    YieldToOthers,
)
from pd_editor.editor.commands.poses import SetAgentPosition, SnapToLane
from pd_editor.editor.commands.road import SetRoadWarp
from pd_editor.editor.edit_findings import about_term
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS
from pd_editor.scene.roles.traffic_choice import trajectory_locked_ids
from pd_editor.scene.scenario import EGO_ID, Scenario

_REGENERATED: Final = frozenset(
    {
        "later-collision",
        "later-off-road",
        "against-traffic",
        "impossible-motion",
        "harsh-motion",
        "near-pass",
        "short-time",
        "far-from-lane",
        "guidance-not-run",
        "guidance-not-met",
    }
)
"""Kinds that other trajectories may cure."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cure:
    """A cure: a command to apply, or agents whose trajectories to regenerate."""

    label: str
    command: Command | None = None
    regenerated_ids: tuple[str, ...] = ()


def cures(
    scenario: Scenario,
    finding: Finding,
    findings: Collection[Finding],
    untouched: Collection[str] = (),
) -> tuple[Cure, ...]:
    """Find cures of one of several findings; ``untouched`` agents move as recorded.

    Commands are tried on the scenario, which does not change: a command is offered if
    the finding is gone after it, with fewer problems than before, or for other findings
    fewer faults and no more problems; of several
    with one label the first. It is not
    known beforehand whether regenerated trajectories help, so they are offered if
    possible.
    """
    if finding.severity in ("remark", "property") and finding.kind != "far-from-lane":
        return ()
    if finding.kind.startswith("guidance"):
        return tuple(_of_guidance(scenario, finding, untouched))
    others: list[Cure] = []
    if finding.kind in _REGENERATED:
        others += regenerations(scenario, finding.agent_ids, untouched)
    helping: dict[str, Cure] = {}
    tried = list(_tried(scenario, finding, findings))
    before = _counts(scene_findings(scenario)) if tried else (0, 0)
    for cure in tried:
        if cure.label not in helping and _helps(scenario, finding, cure, before):
            helping[cure.label] = cure
    removed = removals(scenario, finding.agent_ids)
    if finding.is_problem:
        return (*others, *helping.values(), *removed)
    return (*helping.values(), *others, *removed)


def _of_guidance(
    scenario: Scenario, finding: Finding, untouched: Collection[str]
) -> Iterator[Cure]:
    """Offer to run a term of guidance, or to remove it."""
    yield from regenerations(scenario, finding.agent_ids, untouched)
    for index, term in enumerate(scenario.guidance):
        if finding.about == about_term(term):
            command = RemoveGuidance(index=index)
            yield Cure(label=f"Remove the {term.name}", command=command)


def regenerations(
    scenario: Scenario, agent_ids: tuple[str, ...], untouched: Collection[str]
) -> Iterator[Cure]:
    """Offer regenerated trajectories for one or two agents of the current step."""
    agents, now = scenario.agents, scenario.current_step
    users = agents.kind_mask(ROAD_USER_KINDS)
    rows = [agents.row_of[name] for name in agent_ids]
    if not all(agents.is_valid[row, now] and users[row] for row in rows):
        return
    locked = trajectory_locked_ids(scenario)
    free = tuple(name for name in agent_ids if name not in locked)
    edited = tuple(name for name in free if name not in untouched)
    if 0 < len(edited) < len(free):
        yield Cure(label=f"Regenerate {edited[0]}", regenerated_ids=edited)
    if free:
        label = "Regenerate both" if len(free) == 2 else f"Regenerate {free[0]}"
        yield Cure(label=label, regenerated_ids=free)


def _tried(
    scenario: Scenario, finding: Finding, findings: Collection[Finding]
) -> Iterator[Cure]:
    """Commands that may help, by what the finding is."""
    applied, kind, ids = scenario.applied_warp, finding.kind, finding.agent_ids
    if kind == "friction":
        yield from _slowing(scenario, finding, findings)
    elif kind in ("harsh-motion", "impossible-motion"):
        alike = tuple(one.agent_ids[0] for one in findings if one.kind == kind)
        for some in dict.fromkeys((ids, alike)):
            what = f"the motion of {ids[0]}" if some == ids else f"all {len(some)}"
            command = SlowToComfort(agent_ids=some)
            yield Cure(label=f"Smooth {what}", command=command)
    elif not ids and applied is not None:
        weaker = weakened_to_radius(applied.warp)
        if weaker is not None:
            yield Cure(
                label="Weaken the bend",
                command=SetRoadWarp(
                    warp=weaker, friction_coefficient=applied.friction_coefficient
                ),
            )
        yield Cure(label="Reset the road", command=SetRoadWarp(warp=None))
    else:
        if kind in ("later-collision", "short-time", "near-pass"):
            yield from yielding(ids)
        agents, now = scenario.agents, scenario.current_step
        follows = agents.kind_mask(LANE_FOLLOWER_KINDS)
        for name in ids:
            row = agents.row_of[name]
            if agents.is_valid[row, now] and follows[row]:
                yield Cure(
                    label=f"Snap {name} to its lane",
                    command=SnapToLane(agent_ids=(name,)),
                )
                if kind == "off-road":
                    yield from _returns(scenario, name)


def _returns(scenario: Scenario, agent_id: str) -> Iterator[Cure]:
    """Offer to move an agent just onto the road, such as a parked one far from lanes."""
    agents, now = scenario.agents, scenario.current_step
    here = agents.position_m[agents.row_of[agent_id], now]
    # How far within the road's edge the centre of an agent is moved.
    place = nearest_on_road(scenario, here, 0.3)
    if place is not None:
        x, y = place.tolist()
        yield Cure(
            label=f"Move {agent_id} onto the road",
            command=SetAgentPosition(agent_id=agent_id, x_m=x, y_m=y),
        )


def _slowing(
    scenario: Scenario, problem: Finding, problems: Collection[Finding]
) -> Iterator[Cure]:
    """Offer that the agent of a problem, or all that are too fast, are slowed.

    All are slowed by the setting of the bent road, if there is one, which stays in force.
    """
    applied, mu = scenario.applied_warp, friction_coefficient_of(scenario)
    fast = tuple(p.agent_ids[0] for p in problems if p.kind == "friction")
    for ids in dict.fromkeys((problem.agent_ids, fast)):
        label = f"Slow {ids[0] if len(ids) == 1 else f'all {len(ids)}'} to the limit"
        if ids == fast and applied is not None:
            road = SetRoadWarp(warp=applied.warp, friction_coefficient=mu)
            yield Cure(label=label, command=road)
        slow = SlowToFrictionLimit(agent_ids=ids, friction_coefficient=mu)
        yield Cure(label=label, command=slow)


def yielding(agent_ids: tuple[str, ...]) -> Iterator[Cure]:
    """Offer that each of some agents yields."""
    for name in agent_ids:
        yield Cure(label=f"Let {name} yield", command=YieldToOthers(agent_ids=(name,)))


def _helps(
    scenario: Scenario, finding: Finding, cure: Cure, before: tuple[int, int]
) -> bool:
    """Whether the finding is gone after a command, and nothing worse has come."""
    assert cure.command is not None
    try:
        after = apply_within_locks(cure.command, scenario)
    except PdEditorError:
        return False
    if after is scenario:
        return False
    found = scene_findings(after)
    problems, faults = _counts(found)
    if finding.kind == "far-from-lane":
        rows = scorecard(after, found)
        found = tuple(one for row in rows for one in row.findings)
    is_better = (
        problems < before[0]
        if finding.is_problem
        else problems <= before[0] and faults <= before[1] - finding.is_fault
    )
    return is_better and all(one.key != finding.key for one in found)


def _counts(findings: Collection[Finding]) -> tuple[int, int]:
    """Number of problems, and of all faults."""
    return sum(f.is_problem for f in findings), sum(f.is_fault for f in findings)


def removals(scenario: Scenario, agent_ids: tuple[str, ...]) -> Iterator[Cure]:
    """Offer to delete agents, later ones first, but not focal, ego and locked ones."""
    agents, now = scenario.agents, scenario.current_step
    stays = {scenario.focal_id, EGO_ID, *scenario.locks}
    names = [n for n in agent_ids if n not in stays]
    later = [n for n in names if not agents.is_valid[agents.row_of[n], now]]
    for name in later or names:
        label = f"Remove {name}"
        if later:
            label += " (appears later)"
        yield Cure(label=label, command=DeleteAgents(agent_ids=(name,)))
