"""Guided generations and their reports, by the traffic that they led to."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

from pd_editor.analysis.guidance.report import guidance_reports
from pd_editor.editor.commands import Command, ReplaceTraffic, traffic_command
from pd_editor.editor.history import HistoryEntry
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    GuidanceReport,
)
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class GuidedRun:
    """A generation with guidance, and the sample of it that was applied."""

    request: GenerationRequest
    traffic: GeneratedTraffic
    index: int
    removed_ids: tuple[str, ...] = ()

    @property
    def report(self) -> GuidanceReport:
        """How the sample meets the terms."""
        return self.traffic.guidance[self.index]

    @property
    def replaces_states(self) -> bool:
        """Whether the run placed or removed agents, and so cannot be applied on top."""
        return self.request.samples_states or bool(self.removed_ids)

    def unguided_command(self) -> Command | None:
        """Command that applies the unguided sample; None if there is none."""
        unguided = self.report.unguided
        if unguided is None:
            return None
        traffic = replace(self.traffic, samples=(unguided,), guidance=(), notes=())
        command = traffic_command(
            self.request, traffic, 0, removed_ids=self.removed_ids
        )
        return replace(command, request=replace(command.request, is_unguided=True))


class GuidedRuns:
    """Runs by the tracks of the scenario that they were applied to.

    Undo and redo bring the same tracks back, and with them their report. Runs are
    forgotten with their tracks.
    """

    def __init__(self, obeying: Collection[str]) -> None:
        """Know no run; ``obeying`` are the names of generators that take guidance."""
        self._obeying = obeying
        self._runs: WeakKeyDictionary[AgentTracks, GuidedRun] = WeakKeyDictionary()
        self._unjudged: WeakKeyDictionary[AgentTracks, _AppliedRun] = (
            WeakKeyDictionary()
        )
        """Runs of a history that was read again, whose reports are not made yet."""

    def keep(self, agents: AgentTracks, run: GuidedRun) -> None:
        """Keep a run, if it was guided."""
        if run.traffic.guidance:
            self._runs[agents] = run

    def read_again(self, entries: Iterable[HistoryEntry]) -> None:
        """Know the runs of a history that was read from disk.

        Their reports are made anew, without the comparison with an unguided sample.
        """
        for entry in entries:
            command, before, after = entry.command, entry.before, entry.after
            if (
                isinstance(command, ReplaceTraffic)
                and command.generator in self._obeying
                and before is not None
                and after is not None
            ):
                applied = _AppliedRun(before=before.scenario, command=command)
                self._unjudged[after.scenario.agents] = applied

    def of(self, agents: AgentTracks) -> GuidedRun | None:
        """The run that led to these tracks."""
        unjudged = self._unjudged.pop(agents, None)
        if unjudged is not None and agents not in self._runs:
            self.keep(agents, unjudged.judged())
        return self._runs.get(agents)


@dataclass(frozen=True, kw_only=True, eq=False)
class _AppliedRun:
    """An edit that applied a run, and the scenario before it."""

    before: Scenario
    command: ReplaceTraffic

    def judged(self) -> GuidedRun:
        """The run with its report."""
        command = self.command
        request = command.request.request(self.before, command.seed)
        samples, terms = (command.sample,), request.terms
        traffic = GeneratedTraffic(
            samples=samples,
            generator=command.generator,
            model_sha256=command.model_sha256,
            seed=command.seed,
            guidance=guidance_reports(request.scenario, samples, terms)
            if terms
            else (),
        )
        return GuidedRun(
            request=request,
            traffic=traffic,
            index=0,
            removed_ids=command.request.removed_ids,
        )
