"""Problems of the current scenario: new, ignored and recorded ones."""

from pd_editor.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.problems.check import SceneCheck, checked, scene_problems
from pd_editor.problems.scene_problem import ProblemKey, SceneProblem
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.workspace import Workspace


class ProblemWatch:
    """Checks for problems, and stores which of them the user ignores."""

    def __init__(self, workspace: Workspace) -> None:
        """Make a watch without results."""
        self._workspace = workspace
        self._base: Scenario | None = None
        self._recorded: tuple[SceneProblem, ...] = ()
        self._check = SceneCheck()

    def check(self, *, with_future: bool) -> None:
        """Check the scenario.

        Without the future, earlier results about the future are kept, so that counts do
        not jump during a drag.
        """
        session = self._workspace.session
        if self._base is not session.base:
            self._base = session.base
            self._recorded = scene_problems(session.base)
            self._check = SceneCheck()
        found = checked(
            session.scenario, session.base, self._recorded, with_future=with_future
        )
        if not with_future:
            there = session.scenario.agents.row_of
            found = SceneCheck(
                new=_kept(found.new, self._check.new, there),
                recorded=_kept(found.recorded, self._check.recorded, there),
            )
        self._check = found

    @property
    def new(self) -> tuple[SceneProblem, ...]:
        """Problems that edits caused and the user does not ignore."""
        ignored = self._ignored
        return tuple(p for p in self._check.new if p.key not in ignored)

    @property
    def ignored(self) -> tuple[SceneProblem, ...]:
        """Problems that the user ignores."""
        ignored = self._ignored
        return tuple(p for p in self._check.new if p.key in ignored)

    @property
    def recorded(self) -> tuple[SceneProblem, ...]:
        """Problems of the recording itself."""
        return self._check.recorded

    def ignore(self, problem: SceneProblem, is_ignored: bool) -> None:
        """Ignore a problem, or no longer; kept as long as the scenario's session."""
        if is_ignored:
            self._ignored.add(problem.key)
        else:
            self._ignored.discard(problem.key)

    def agents_at(self, step: float) -> frozenset[str]:
        """Agents with a new problem at a step."""
        return frozenset(
            agent_id
            for problem in self.new
            if problem.holds_at(step)
            for agent_id in problem.agent_ids
        )

    def problem_ids(self) -> tuple[frozenset[str], frozenset[str]]:
        """Agents with a new problem at any time, and those with one after t = 0."""
        named = [(problem.is_now, problem.agent_ids) for problem in self.new]
        everywhere = frozenset(name for _, ids in named for name in ids)
        later = frozenset(name for is_now, ids in named if not is_now for name in ids)
        return everywhere, later

    def untouched(self) -> frozenset[str]:
        """Ids of agents that move as recorded."""
        session = self._workspace.session
        return untouched_agent_ids(session.scenario, session.base)

    @property
    def _ignored(self) -> set[ProblemKey]:
        return self._workspace.ignored_problems.setdefault(
            self._workspace.session.base, set()
        )


def _kept(
    found: tuple[SceneProblem, ...],
    former: tuple[SceneProblem, ...],
    there: dict[str, int],
) -> tuple[SceneProblem, ...]:
    """New results on the current step, with former results on the future."""
    known = {problem.key for problem in found}
    return found + tuple(
        problem
        for problem in former
        if not problem.is_now
        and problem.key not in known
        and all(name in there for name in problem.agent_ids)
    )
