"""The list of findings of the current scenario: new, ignored and recorded ones."""

from collections import deque
from dataclasses import replace
from typing import Final

from pd_editor.analysis.findings.check import SceneCheck, scene_findings
from pd_editor.analysis.findings.finding import Finding
from pd_editor.editor.commands import Command
from pd_editor.editor.edit_findings import carried_agent_ids, edit_findings
from pd_editor.scene.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.workspace import Workspace

_MOST_WHOLES: Final = 8
"""Scenarios whose findings are remembered: branches between which a user switches."""


class FindingWatch:
    """Looks for findings, and stores which of them the user ignores."""

    def __init__(self, workspace: Workspace) -> None:
        """Make a watch without results."""
        self._workspace = workspace
        self._base: Scenario | None = None
        self._recorded: tuple[Finding, ...] = ()
        self._check = SceneCheck()
        self._whole: Scenario | None = None
        self._wholes: deque[tuple[Scenario, tuple[Command, ...], SceneCheck]]
        self._wholes = deque(maxlen=_MOST_WHOLES)

    def check(self, *, with_future: bool) -> None:
        """Check the scenario.

        Without the future, earlier results about the future are kept, so that counts do
        not jump during a drag.
        """
        session = self._workspace.session
        scenario = session.scenario
        if self._base is not session.original:
            self._base = session.original
            self._recorded = scene_findings(session.original)
            self._check = SceneCheck()
            self._wholes.clear()
        commands = session.commands_in_force
        for known, by, whole in self._wholes:
            if known is scenario and by == commands:
                self._check, self._whole = whole, scenario
                return
        found = edit_findings(
            scenario,
            session.base,
            commands,
            self._recorded,
            with_future=with_future,
        )
        if with_future:
            self._wholes.append((scenario, commands, found))
        else:
            there = scenario.agents.row_of
            found = SceneCheck(
                new=_kept(found.new, self._check.new, there),
                recorded=_kept(found.recorded, self._check.recorded, there),
            )
        self._check, self._whole = found, scenario if with_future else None

    def whole(self) -> SceneCheck:
        """The list with the future of the current scenario, made if it is not yet."""
        if self._whole is not self._workspace.session.scenario:
            self.check(with_future=True)
        return self._check

    @property
    def new(self) -> tuple[Finding, ...]:
        """Problems that edits caused and the user does not ignore."""
        return tuple(one for one in self._unignored() if one.is_problem)

    @property
    def notices(self) -> tuple[Finding, ...]:
        """Other findings that edits caused and the user does not ignore."""
        return tuple(one for one in self._unignored() if not one.is_problem)

    @property
    def ignored(self) -> tuple[Finding, ...]:
        """Findings that the user ignores."""
        ignored = self._workspace.session.variant.ignored
        return tuple(one for one in self._check.new if one.ignored_key in ignored)

    @property
    def recorded(self) -> tuple[Finding, ...]:
        """Findings of the recording itself, problems first."""
        found = self._check.recorded
        return tuple(sorted(found, key=lambda one: not one.is_problem))

    def _unignored(self) -> tuple[Finding, ...]:
        ignored = self._workspace.session.variant.ignored
        return tuple(one for one in self._check.new if one.ignored_key not in ignored)

    def ignore(self, finding: Finding, is_ignored: bool) -> None:
        """Ignore a finding, or no longer; the scenario's recipe says so."""
        session, key = self._workspace.session, finding.ignored_key
        ignored = tuple(one for one in session.variant.ignored if one != key)
        ignored += (key,) * is_ignored
        session.describe(replace(session.variant, ignored=ignored))

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

    def stale_ids(self) -> frozenset[str]:
        """Agents whose trajectory was moved by an edit and no longer fits the road."""
        carried = carried_agent_ids(self._workspace.session.commands_in_force)
        return carried & self.problem_ids()[1] if carried else carried

    def untouched(self) -> frozenset[str]:
        """Ids of agents that move as recorded."""
        session = self._workspace.session
        return untouched_agent_ids(session.scenario, session.original)


def _kept(
    found: tuple[Finding, ...], former: tuple[Finding, ...], there: dict[str, int]
) -> tuple[Finding, ...]:
    """New results on the current step, with former results on the future."""
    known = {problem.key for problem in found}
    return found + tuple(
        problem
        for problem in former
        if not problem.is_now
        and problem.key not in known
        and all(name in there for name in problem.agent_ids)
    )
