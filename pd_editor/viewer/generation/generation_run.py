"""Runs one generation at a time: progress, samples, and their application."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from pd_editor.base.errors import GenerationError
from pd_editor.base.plain_text import number_of
from pd_editor.editor.background_job import GenerationJob
from pd_editor.editor.commands import Command, ReplaceTraffic, traffic_command
from pd_editor.editor.live_regeneration import CLOSE_WAIT_S
from pd_editor.scene.agent_states import STEPPED
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    ScenarioGenerator,
    check_placed,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import TrafficSample
from pd_editor.viewer.generation.sample_strip import SampleSet, SampleStrip
from pd_editor.viewer.overlay.messages import Tone
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.state.guided_runs import GuidedRun
from pd_editor.viewer.tab.tab_model import RunState
from pd_editor.viewer.tab.ui_context import UiContext


@dataclass(frozen=True, kw_only=True)
class LazyGenerator:
    """A generator that is made in the thread that runs it."""

    name: str
    make: Callable[[], ScenarioGenerator]

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Make the generator, then run it.

        Raises:
            PdEditorError: the generator cannot be made, or refuses the request.
        """
        yield GenerationProgress(fraction=0.0, message=f"Preparing {self.name}")
        return (yield from self.make().generate(request))


@dataclass(frozen=True, kw_only=True, eq=False)
class RunInput(ABC):
    """What a run is to do for a state of the session, and how its result is applied."""

    base: Scenario
    """The session's scenario, which still contains the agents to be removed."""
    is_cure: bool = False
    """Whether it mends the sample that is applied: the others can still be chosen."""

    @abstractmethod
    def steps(
        self, generator: LazyGenerator
    ) -> Generator[GenerationProgress, None, Any]:
        """Do the work; ends with the result."""

    @abstractmethod
    def in_words(self, progress: GenerationProgress) -> str:
        """What is being done."""

    @abstractmethod
    def command(self, result: Any, index: int, edited: Scenario) -> Command:
        """The edit that applies the result, or one of its samples, to a scenario."""

    @abstractmethod
    def applied(
        self, ui: UiContext, result: Any, index: int, command: Command, took_s: float
    ) -> str:
        """Report on what has been applied."""

    def check(self, result: Any) -> None:  # noqa: B027
        """Refuse a result that is not to be applied.

        Raises:
            GenerationError: it would change nothing, for example.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class GenerationInput(RunInput):
    """Input of a generation: the request and the state of the session."""

    request: GenerationRequest
    removed_ids: tuple[str, ...] = ()

    def steps(
        self, generator: LazyGenerator
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Generate."""
        return generator.generate(self.request)

    def in_words(self, progress: GenerationProgress) -> str:
        """What is being done, and for which sample."""
        request = self.request
        text = "Resampling" if request.samples_states else "Regenerating"
        has_several = request.num_samples > 1
        is_told = progress.fraction == 0 or (has_several and request.samples_states)
        if is_told and progress.message:
            text = progress.message
        elif has_several:
            number = int(progress.fraction * request.num_samples + 1e-6) + 1
            number = min(number, request.num_samples)
            text = f"Sample {number} of {request.num_samples}"
        return text

    def check(self, result: GeneratedTraffic) -> None:
        """Refuse a result that would only remove agents."""
        check_placed(result, len(self.removed_ids))

    def command(
        self, result: GeneratedTraffic, index: int, edited: Scenario
    ) -> ReplaceTraffic:
        """The edit that applies a sample to a scenario."""
        removed = self.removed_ids
        return traffic_command(
            self.request, result, index, removed_ids=removed, edited=edited
        )

    def applied(
        self,
        ui: UiContext,
        result: GeneratedTraffic,
        index: int,
        command: Command,
        took_s: float,
    ) -> str:
        """Report on a sample, and keep what guidance did."""
        run = GuidedRun(
            request=self.request,
            traffic=result,
            index=index,
            removed_ids=self.removed_ids,
        )
        ui.workspace.guided_runs.keep(ui.session.scenario.agents, run)
        assert isinstance(command, ReplaceTraffic)
        count = number_of(len(result.samples[index].ids), "agent")
        # A bar has room for the beginning alone: what a user must know comes first.
        done = f"{count} in {took_s:.1f} s, seed {self.request.seed}."
        return " ".join((*result.notes, *command.notes, done, *result.measures))


class GenerationRun:
    """Runs a generator in a background thread and applies its samples."""

    def __init__(self, ui: UiContext, strip: SampleStrip) -> None:
        """Run nothing yet; the strip offers the samples of a run."""
        self._ui = ui
        self._strip = strip
        strip.adopted.subscribe(self.adopt)
        self.changed = Signal[()]()
        """``state`` or ``said`` has changed."""
        self.said = ""
        """Report on the last run, or why there was none."""
        self.tone: Tone = ""
        self._failed_at: tuple[Scenario, tuple[str, ...]] | None = None
        self._job: GenerationJob[Any] | None = None
        self._state: RunState | None = None
        self._generated: tuple[RunInput, Any] | None = None
        self._waits = False
        self._before: Scenario | None = None
        """The scenario to which a sample of the last run was applied."""
        self._applied: Scenario | None = None
        self._cured: list[Scenario] = []
        """What cures have made of it."""
        self._index = 0
        self._took_s = 0.0
        if ui.workspace.has_lost_run:
            ui.workspace.has_lost_run = False
            self._say(_LOST, "warn")
            ui.notify("Generation cancelled", _LOST, "warning", stays=True)

    @property
    def is_running(self) -> bool:
        """Whether a generation is running."""
        return self._job is not None

    @property
    def state(self) -> RunState | None:
        """State for the page; None without a run and a waiting result."""
        if self._state is not None:
            return self._state
        use = self._use()
        if use is None:
            return None
        return RunState(
            action="Use result" if use == "here" else "Go to its state, use result"
        )

    def start(
        self, name: str, make: Callable[[], ScenarioGenerator], task: RunInput
    ) -> None:
        """Start a generation; the generator is made and loaded in the background.

        Raises:
            GenerationError: a generation is running already.
        """
        if self._job is not None:
            raise GenerationError("A generation is running already; cancel it first.")
        if not task.is_cure:
            self.forget()
        started = time.monotonic()
        post, generator = self._ui.post, LazyGenerator(name=name, make=make)

        def only_if_current(action: Callable[[], None]) -> Callable[[], None]:
            return lambda: action() if self._job is job else None

        job = GenerationJob(
            name,
            lambda: task.steps(generator),
            on_progress=lambda p: post(
                only_if_current(lambda: self._progressed(task, p)), "progress"
            ),
            on_done=lambda t: post(
                only_if_current(lambda: self._finished(task, t, started))
            ),
            on_error=lambda e: post(only_if_current(lambda: self._failed(e))),
        )
        self._job = job
        self._progressed(task, GenerationProgress(fraction=0.0, message=""))
        job.start()

    def show(self) -> None:
        """Follow the session: remove texts about another state."""
        now = self._ui.session.scenario
        is_shown = self._applied is not None and now is self._applied
        samples = self._samples()
        count = len(samples) if _differ(samples) else 1
        is_cured = any(now is one for one in self._cured)
        is_offered = is_cured or (self._before is not None and now is self._before)
        self._strip.follow(
            self._index if is_shown else None,
            is_valid=count > 1 and (is_shown or is_offered),
        )
        if (self._applied or self._cured) and not (is_shown or is_cured):
            self._say("")
        state, failed_at = self._ui.session.state, self._failed_at
        if failed_at is not None and (state.scenario, state.selection) != failed_at:
            self._say("")
        if self._waits:
            self._say(_WORDS_OF_USE[self._use()], "warn")

    def close(self) -> None:
        """Stop a running generation, because its page is gone."""
        if self._job is not None:
            self._ui.workspace.has_lost_run = True
            self._job.cancel()
            # A thread that is ended inside torch aborts the process at its exit.
            self._job.wait(CLOSE_WAIT_S)

    def cancel(self) -> None:
        """Stop the generator within one step; nothing changes."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
            self._set_state(None)
            self._say("Cancelled.")

    def use_result(self) -> None:
        """Apply a result that came after an edit.

        If the road and the agents' states are still the same, it is applied to the
        current scenario; otherwise later edits are undone first.
        """
        use = self._use()
        if use is None or self._generated is None:
            return
        base = self._generated[0].base
        self._waits = False
        if use == "back":
            number = self._edit_of(base)
            assert number is not None
            self._ui.commit_gesture()
            self._ui.session.go_to(number)
        self._apply(0)

    def forget(self) -> None:
        """Remove the report of the last run and its samples."""
        self._generated, self._applied, self._waits = None, None, False
        self._before, self._cured = None, []
        self._strip.forget()
        self._say("")
        self.show()

    def tell_reaction(
        self, request: GenerationRequest, traffic: GeneratedTraffic
    ) -> None:
        """Report on trajectories that were regenerated for the edit that is shown."""
        self.forget()
        agents = self._ui.session.scenario.agents
        run = GuidedRun(request=request, traffic=traffic, index=0)
        self._ui.workspace.guided_runs.keep(agents, run)
        done = f"{number_of(len(request.agent_ids), 'agent')} reacted to the edit."
        self._say(" ".join((*traffic.notes, done, *traffic.measures)))

    def _use(self) -> Literal["here", "back"] | None:
        """How a waiting result can be applied; None without one, or if it cannot."""
        if self._generated is None or not self._waits:
            return None
        base, now = self._generated[0].base, self._ui.session.scenario
        if now.road_map is base.road_map and _same_states(base, now):
            return "here"
        return None if self._edit_of(base) is None else "back"

    def _edit_of(self, scenario: Scenario) -> int | None:
        """Number of the edit after which the session had a scenario.

        None if it never had, or if that state cannot be restored any more.
        """
        session = self._ui.session
        if scenario is session.base:
            return 0
        for number, entry in enumerate(session.all_entries, start=1):
            if entry.after is not None and entry.after.scenario is scenario:
                return number
        return None

    def _samples(self) -> tuple[TrafficSample, ...]:
        """What there is to choose among."""
        if self._generated is None:
            return ()
        task, result = self._generated
        return result.samples if isinstance(task, GenerationInput) else ()

    def _progressed(self, task: RunInput, progress: GenerationProgress) -> None:
        text = task.in_words(progress)
        self._set_state(RunState(text=text, fraction=round(progress.fraction, 3)))

    def _finished(self, task: RunInput, result: Any, started: float) -> None:
        self._job = None
        self._set_state(None)
        try:
            task.check(result)
        except GenerationError as error:
            self._failed(error)
            return
        self._took_s = time.monotonic() - started
        if task.is_cure and self._ui.session.scenario is task.base:
            self._put(task, result, 0)
            self._cured.append(self._ui.session.scenario)
            self.show()
            self.changed.emit()
            return
        if task.is_cure:
            self.forget()
        self._generated = task, result
        if self._ui.session.scenario is task.base:
            self._apply(0)
        else:
            self._waits = True
            self.show()
        self.changed.emit()

    def _apply(self, index: int) -> None:
        assert self._generated is not None
        task, result = self._generated
        self._applied = None
        self._ui.commit_gesture()
        before, done = self._ui.session.scenario, self._ui.session.commands_in_force
        self._put(task, result, index)
        self._applied, self._index = self._ui.session.scenario, index
        self._cured = []
        if before is not self._before:
            self._before = before
            self._offer_samples(before, done)
        self.show()

    def _put(self, task: RunInput, result: Any, index: int) -> None:
        """Apply a sample, and report on it."""
        command = task.command(result, index, self._ui.session.scenario)
        self._ui.apply(command)
        self._say(task.applied(self._ui, result, index, command, self._took_s))

    def _offer_samples(self, before: Scenario, done: tuple[Command, ...]) -> None:
        assert self._generated is not None
        (task, result), samples = self._generated, self._samples()
        if not isinstance(task, GenerationInput) or not _differ(samples):
            return
        indices = range(len(samples))
        commands = tuple(task.command(result, index, before) for index in indices)
        self._strip.open(
            SampleSet(
                before=before,
                base=self._ui.session.base,
                done=done,
                samples=samples,
                commands=commands,
            )
        )

    def adopt(self, index: int) -> None:
        """Apply a sample of the last run in the place of the one that is applied.

        Nothing happens if the scenario was edited since.
        """
        now = self._ui.session.scenario
        mine = (self._applied, *self._cured)
        if self._generated is not None and any(now is one for one in mine):
            while self._ui.session.scenario is not self._before:
                self._ui.session.undo()
            self._apply(index)
        elif self._generated is not None and now is self._before:
            self._apply(index)
        else:
            self.show()

    def _failed(self, error: Exception) -> None:
        self._job = None
        self._set_state(None)
        self.refuse(error)
        self._ui.report(error)

    def refuse(self, error: Exception) -> None:
        """Say why there is no run, until something else is shown or selected."""
        state = self._ui.session.state
        self._say(str(error), "bad")
        self._failed_at = state.scenario, state.selection

    def _say(self, text: str, tone: Tone = "") -> None:
        self._failed_at = None
        if text != self.said:
            self.said, self.tone = text, tone
            self.changed.emit()

    def _set_state(self, state: RunState | None) -> None:
        if state != self._state:
            self._state = state
            self.changed.emit()


_LOST: Final = "Its page was closed or loaded again while it ran."
_WORDS_OF_USE: Final[Mapping[str | None, str]] = {
    "here": "The scenario was edited during the run, and the result still fits: "
    '"Use result" applies it.',
    "back": 'The scenario was edited during the run. "Use result" goes to the state '
    "that it was made for; edits after it are undone.",
    None: "The state that the result was made for is no longer in the history, so it "
    "cannot be used.",
}


def _differ(samples: Sequence[TrafficSample]) -> bool:
    """Whether there is a choice among some samples."""
    return any(not samples[0].is_equal(one) for one in samples[1:])


def _same_states(one: Scenario, other: Scenario) -> bool:
    """Whether the same agents have equal states at the current step."""
    step = one.current_step
    return one.agents.ids == other.agents.ids and all(
        np.array_equal(
            getattr(one.agents, name)[:, step], getattr(other.agents, name)[:, step]
        )
        for name in STEPPED
    )
