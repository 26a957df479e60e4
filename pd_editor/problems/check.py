"""List of all problems of a scenario, and which of them edits have caused."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.problems.collisions import collisions
from pd_editor.problems.friction import friction_problems
from pd_editor.problems.road_departures import road_departures
from pd_editor.problems.road_shape import road_problems
from pd_editor.problems.scene_problem import SceneProblem
from pd_editor.scene.scenario import Scenario

_WORSE: Final = 1.2
"""Ratio of severities above which a recorded problem counts as caused by edits."""


@dataclass(frozen=True, kw_only=True)
class SceneCheck:
    """Problems of a scenario: those caused by edits, and recorded ones."""

    new: tuple[SceneProblem, ...] = ()
    recorded: tuple[SceneProblem, ...] = ()


def scene_problems(
    scenario: Scenario, *, with_future: bool = True
) -> tuple[SceneProblem, ...]:
    """Find problems from the current step on, in the order of time.

    Without the future only the current step and the road are checked.
    """
    now = scenario.current_step
    end = scenario.time_axis.num_steps if with_future else now + 1
    steps = np.arange(now, end)
    found = [
        *road_problems(scenario),
        *collisions(scenario, steps),
        *road_departures(scenario, steps),
    ]
    if with_future:
        found += friction_problems(scenario)
    return tuple(sorted(found, key=lambda problem: problem.first_step))


def checked(
    scenario: Scenario,
    base: Scenario,
    recorded: Iterable[SceneProblem],
    *,
    with_future: bool = True,
) -> SceneCheck:
    """Check a scenario that was made from ``base`` by edits.

    ``recorded`` are the problems of ``base``, which a session stores. If ``base`` is an
    earlier export, problems that its edits have caused count as caused by edits.
    """
    provenance = base.provenance
    now = scenario.current_step
    return split(
        scene_problems(scenario, with_future=with_future),
        [one for one in recorded if provenance.is_recorded(one.agent_ids)],
        unmoved=untouched_agent_ids(scenario, base, slice(now, now + 1)),
        untouched=untouched_agent_ids(scenario, base),
    )


def split(
    problems: Iterable[SceneProblem],
    recorded: Iterable[SceneProblem],
    *,
    unmoved: Collection[str],
    untouched: Collection[str],
) -> SceneCheck:
    """Split problems into those caused by edits and recorded ones.

    Args:
        problems: problems of the edited scenario.
        recorded: problems of the recording.
        unmoved: agents whose state at the current step is as recorded. A recorded
            problem at that step stays a recorded one if it involves only these.
        untouched: agents whose whole trajectory is as recorded; likewise for
            problems at later steps.
    """
    known = {problem.key: problem.severity for problem in recorded}
    same_now, same_later = frozenset(unmoved), frozenset(untouched)

    def is_recorded(problem: SceneProblem) -> bool:
        if problem.key not in known:
            return False
        # A warp can turn a slight recorded excess of speed into a large one.
        if problem.kind == "friction" and (
            problem.severity > _WORSE * known[problem.key]
        ):
            return False
        same = same_now if problem.is_now else same_later
        return same.issuperset(problem.agent_ids)

    new: list[SceneProblem] = []
    own: list[SceneProblem] = []
    for problem in problems:
        (own if is_recorded(problem) else new).append(problem)
    return SceneCheck(new=tuple(new), recorded=tuple(own))
