"""One generation at a time: its progress, its samples, what becomes of them."""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from pd_editor.editor.commands import traffic_command
from pd_editor.editor.generation_job import GenerationJob
from pd_editor.errors import GenerationError
from pd_editor.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    ScenarioGenerator,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.desk import Desk, set_property, set_value
from pd_editor.viewer.state.page_text import plain


@dataclass(frozen=True, kw_only=True, eq=False)
class Draw:
    """What is asked of a generator, and of which state of the session."""

    base: Scenario
    """The session's scenario, which still holds the agents to be removed."""
    request: GenerationRequest
    removed_ids: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MadeWhenAsked:
    """A generator that is made by the thread that lets it draw."""

    name: str
    make: Callable[[], ScenarioGenerator]

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Make it, then let it draw.

        Raises:
            PdEditorError: it cannot be made, or refuses the request.
        """
        yield GenerationProgress(fraction=0.0, message=f"Preparing {self.name}")
        return (yield from self.make().generate(request))


class GenerationRun:
    """Runs a generator off the session's thread and applies what it draws."""

    def __init__(self, desk: Desk, on_running: Callable[[bool], None]) -> None:
        """Build progress, cancel and the choice of a sample into the container."""
        self._desk = desk
        self._on_running = on_running
        self._job: GenerationJob | None = None
        self._drawn: tuple[Draw, GeneratedTraffic] | None = None
        self._offered = False
        self._applied: Scenario | None = None
        self._session_base = desk.session.base
        gui = desk.client.gui
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._status = gui.add_markdown("")
        self._cancel = gui.add_button("Cancel", color="red", visible=False)
        self._sample = gui.add_slider(
            "Sample", 1, 2, 1, 1, visible=False, hint="Which of the drawn samples"
        )
        self._take = gui.add_button("Apply the offered result", visible=False)
        desk.on_click(self._cancel, self.cancel)
        desk.on_click(self._take, self.take_offered)
        desk.on_change(self._sample, self._sample_chosen, merge_key="sample")

    @property
    def is_running(self) -> bool:
        """Whether a generator is at work."""
        return self._job is not None

    def start(
        self, name: str, make: Callable[[], ScenarioGenerator], draw: Draw
    ) -> None:
        """Let a generator draw; it is made, and loaded, off this thread.

        Raises:
            GenerationError: one is at work already.
        """
        if self._job is not None:
            raise GenerationError("A generation is running already; cancel it first.")
        self._forget()
        self._set_running(True)
        started = time.monotonic()
        post = self._desk.post

        def only_if_current(action: Callable[[], None]) -> Callable[[], None]:
            return lambda: action() if self._job is job else None

        job = GenerationJob(
            generator=MadeWhenAsked(name=name, make=make),
            request=draw.request,
            on_progress=lambda p: post(
                only_if_current(lambda: self._progressed(p)), "progress"
            ),
            on_done=lambda t: post(
                only_if_current(lambda: self._finished(draw, t, started))
            ),
            on_error=lambda e: post(only_if_current(lambda: self._failed(e))),
        )
        self._job = job
        job.start()

    def show(self) -> None:
        """Follow the session: samples of another scenario are of no use."""
        session = self._desk.session
        if session.base is not self._session_base:
            self._session_base = session.base
            self._forget()
        elif self._applied is not None and session.scenario is not self._applied:
            set_property(self._sample, "visible", False)

    def close(self) -> None:
        """Stop what runs; nobody is there to take it."""
        if self._job is not None:
            self._job.cancel()

    def cancel(self) -> None:
        """Stop the generator within one step; nothing changes."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
            self._set_running(False)
            set_property(self._status, "content", "Cancelled.")

    def take_offered(self) -> None:
        """Apply a result that came after an edit, if it still fits.

        Raises:
            GenerationError: the road or an agent's state is another by now.
        """
        if self._drawn is None or not self._offered:
            return
        made_for, now = self._drawn[0].base, self._desk.session.scenario
        self._offered = False
        set_property(self._take, "visible", False)
        if now.road_map is not made_for.road_map or not _same_states(made_for, now):
            raise GenerationError(
                "The road or agents have changed since that was generated, so it no "
                "longer fits; regenerate instead."
            )
        self._apply(0)

    def _progressed(self, progress: GenerationProgress) -> None:
        set_value(self._progress, round(100 * progress.fraction, 1))
        set_property(self._status, "content", plain(progress.message))

    def _finished(self, draw: Draw, traffic: GeneratedTraffic, started: float) -> None:
        self._job = None
        self._set_running(False)
        self._drawn = draw, traffic
        count = len(traffic.samples[0].ids) if traffic.samples else 0
        seconds = time.monotonic() - started
        status = (
            f"{count} agents in {seconds:.1f} s, seed {draw.request.seed}. "
            f"{plain(' '.join(traffic.notes))}"
        )
        if self._desk.session.scenario is draw.base:
            self._apply(0)
        else:
            self._offered = True
            set_property(self._take, "visible", True)
            status += " The scenario was edited meanwhile; apply it if it still fits."
        set_property(self._status, "content", status)

    def _apply(self, index: int) -> None:
        assert self._drawn is not None
        draw, traffic = self._drawn
        self._applied = None
        self._desk.apply(
            traffic_command(draw.request, traffic, index, removed_ids=draw.removed_ids)
        )
        self._applied = self._desk.session.scenario
        if len(traffic.samples) > 1:
            self._sample.max = len(traffic.samples)
            set_value(self._sample, index + 1)
            set_property(self._sample, "visible", True)

    def _sample_chosen(self, number: float) -> None:
        """Put another sample in the place of the one that was just applied."""
        if self._drawn is None or self._desk.session.scenario is not self._applied:
            set_property(self._sample, "visible", False)
            return
        self._desk.session.undo()
        self._apply(int(number) - 1)

    def _forget(self) -> None:
        self._drawn, self._applied, self._offered = None, None, False
        set_property(self._take, "visible", False)
        set_property(self._sample, "visible", False)

    def _failed(self, error: Exception) -> None:
        self._job = None
        self._set_running(False)
        set_property(self._status, "content", "")
        self._desk.report(error)

    def _set_running(self, is_running: bool) -> None:
        set_property(self._progress, "visible", is_running)
        set_property(self._cancel, "visible", is_running)
        set_value(self._progress, 0.0)
        self._on_running(is_running)


def _same_states(one: Scenario, other: Scenario) -> bool:
    """Whether the same agents stand alike at the current step."""
    step = one.current_step
    return one.agents.ids == other.agents.ids and all(
        np.array_equal(
            getattr(one.agents, name)[:, step], getattr(other.agents, name)[:, step]
        )
        for name in ("position_m", "heading_rad", "velocity_mps", "is_valid")
    )
