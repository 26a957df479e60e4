"""Finds cures of findings of the scorecard: commands that are tried and do help."""

from collections.abc import Collection, Iterator
from typing import Final

from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.commands.motion import SlowToComfort
from pd_editor.editor.commands.poses import SnapToLane
from pd_editor.editor.problem_cures import (
    Cure,
    cures,
    regenerations,
    removals,
    yielding,
)
from pd_editor.errors import PdEditorError
from pd_editor.metrics.findings import Finding
from pd_editor.metrics.scorecard import scorecard
from pd_editor.problems.check import scene_problems
from pd_editor.problems.scene_problem import ProblemKind, SceneProblem
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario

_PROBLEMS: Final[dict[str, frozenset[ProblemKind]]] = {
    "init_overlap": frozenset({"collision"}),
    "new_overlap": frozenset({"later-collision", "collision"}),
    "off_drivable": frozenset({"off-road", "later-off-road"}),
}
"""Kinds of problems that a metric counts as well."""


def finding_cures(
    scenario: Scenario,
    finding: Finding,
    alike: Collection[Finding],
    untouched: Collection[str] = (),
) -> tuple[Cure, ...]:
    """Find cures of one finding; ``alike`` are all findings of its metric.

    A finding that is a problem as well has the cures of that problem. Of the others,
    commands are tried on the scenario, which does not change: a command is offered if
    the finding is gone after it and there are not more problems than before. Agents
    with ``untouched`` ids move as recorded.
    """
    if not finding.is_fault and finding.metric != "lateral_deviation_mean":
        return ()
    problems = scene_problems(scenario)
    problem = _problem_of(finding, problems)
    if problem is not None:
        return cures(scenario, problem, problems, untouched)
    count = len(problems)
    faults = sum(one.is_fault for row in scorecard(scenario) for one in row.findings)
    offered = [
        cure
        for cure in _tried(scenario, finding, alike)
        if _helps(scenario, finding, cure.command, count, faults)
    ]
    ids = (finding.agent_id,)
    offered += regenerations(scenario, ids, untouched)
    offered += removals(scenario, ids)
    return tuple(offered)


def _problem_of(
    finding: Finding, problems: Collection[SceneProblem]
) -> SceneProblem | None:
    kinds = _PROBLEMS.get(finding.metric, frozenset())
    found = (
        one
        for one in problems
        if one.kind in kinds and finding.agent_id in one.agent_ids
    )
    return next(found, None)


def _tried(
    scenario: Scenario, finding: Finding, alike: Collection[Finding]
) -> Iterator[Cure]:
    agents, name = scenario.agents, finding.agent_id
    follows = bool(agents.kind_mask(LANE_FOLLOWER_KINDS)[agents.row_of[name]])
    if finding.metric in ("uncomfortable", "impossible"):
        smooth = SlowToComfort(agent_ids=(name,))
        yield Cure(label=f"Smooth the motion of {name}", command=smooth)
        all_ids = tuple(one.agent_id for one in alike)
        if len(all_ids) > 1:
            yield Cure(
                label=f"Smooth all {len(all_ids)}",
                command=SlowToComfort(agent_ids=all_ids),
            )
    elif finding.metric == "critical_time_to_collision":
        yield from yielding((name,))
    elif finding.metric in ("off_drivable", "lateral_deviation_mean") and follows:
        snap = SnapToLane(agent_ids=(name,))
        yield Cure(label=f"Snap {name} to its lane", command=snap)


def _helps(
    scenario: Scenario,
    finding: Finding,
    command: Command | None,
    num_problems: int,
    num_faults: int,
) -> bool:
    """Whether the finding is gone after a command, with fewer faults, no more problems."""
    assert command is not None
    try:
        after = apply_within_locks(command, scenario)
    except PdEditorError:
        return False
    if after is scenario or len(scene_problems(after)) > num_problems:
        return False
    found = [one for row in scorecard(after) for one in row.findings]
    is_gone = not any(
        one.metric == finding.metric and one.agent_id == finding.agent_id
        for one in found
    )
    # A finding that is no fault counts for nothing when it is gone.
    left = sum(one.is_fault for one in found) + finding.is_fault
    return is_gone and left <= num_faults
