"""Guided generations and their reports, by the traffic that they led to."""

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

from pd_editor.editor.commands import Command, traffic_command
from pd_editor.generation import GeneratedTraffic, GenerationRequest, GuidanceReport
from pd_editor.scene.agent_tracks import AgentTracks


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

    def __init__(self) -> None:
        """Know no run."""
        self._runs: WeakKeyDictionary[AgentTracks, GuidedRun] = WeakKeyDictionary()

    def keep(self, agents: AgentTracks, run: GuidedRun) -> None:
        """Keep a run, if it was guided."""
        if run.traffic.guidance:
            self._runs[agents] = run

    def of(self, agents: AgentTracks) -> GuidedRun | None:
        """The run that led to these tracks."""
        return self._runs.get(agents)
