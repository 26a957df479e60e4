"""Live regeneration: generated traffic reacts while an edit is being made."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from pd_editor.base.errors import PdEditorError
from pd_editor.editor.background_job import GenerationJob
from pd_editor.editor.commands import (
    Command,
    RegeneratedEdit,
    ReplaceTraffic,
    traffic_command,
)
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.commands.traffic import carried_to
from pd_editor.editor.session import EditorSession
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    ScenarioGenerator,
)
from pd_editor.scene.scenario import Scenario

LONGEST_GAP_S: Final = 0.1
"""Time without a result after which a run is completed although a newer one waits."""

CLOSE_WAIT_S: Final = 2.0
"""Time in which a cancelled generator finishes its step."""


class NewestRun:
    """Runs one request at a time; of the waiting ones only the newest.

    A run that a newer request has made obsolete is cancelled between two steps, except
    near its end, and except when the last result is old: otherwise frequent requests
    would prevent all results. Callbacks are called on the thread, and none after
    ``drop``.
    """

    def __init__(self) -> None:
        """Make it idle; the first request starts the thread."""
        self._changed = threading.Condition()
        self._waiting: GenerationJob[GeneratedTraffic] | None = None
        self._running: GenerationJob[GeneratedTraffic] | None = None
        self._is_closed = False
        self._thread: threading.Thread | None = None
        self._last_result_s = float("-inf")

    def ask(
        self,
        generator: ScenarioGenerator,
        request: GenerationRequest,
        on_done: Callable[[GeneratedTraffic], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Run a request as soon as possible, instead of the one that waits."""

        def follow(progress: GenerationProgress) -> None:
            if self._is_obsolete(progress):
                job.cancel()

        def done(traffic: GeneratedTraffic) -> None:
            self._last_result_s = time.monotonic()
            on_done(traffic)

        steps = partial(generator.generate, request)
        job = GenerationJob(generator.name, steps, follow, done, on_error)
        with self._changed:
            if self._is_closed:
                return
            self._waiting = job
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._work, name="generate-live", daemon=True
                )
                self._thread.start()
            self._changed.notify()

    def drop(self) -> None:
        """Cancel the running and the waiting request, without result or error."""
        with self._changed:
            self._waiting = None
            if self._running is not None:
                self._running.cancel()

    def close(self, timeout_s: float | None = None) -> None:
        """Drop everything and wait until the thread has ended."""
        self.drop()
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _work(self) -> None:
        while True:
            with self._changed:
                self._running = None
                while self._waiting is None and not self._is_closed:
                    self._changed.wait()
                if self._is_closed:
                    return
                self._running, self._waiting = self._waiting, None
            assert self._running is not None
            self._running.run()

    def _is_obsolete(self, progress: GenerationProgress) -> bool:
        # Share of a run after which it is completed, because its result is near.
        if progress.fraction >= 0.5:
            return False
        with self._changed:
            is_newer_waiting = self._waiting is not None
        age_s = time.monotonic() - self._last_result_s
        return is_newer_waiting and age_s < LONGEST_GAP_S


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveRequests:
    """Generator of live traffic, and its requests during and after an edit."""

    generator: ScenarioGenerator
    draft: Callable[[Scenario], GenerationRequest]
    """Request for a fast preview on an edited scenario."""
    result: Callable[[Scenario], GenerationRequest]
    """Request with the usual settings, at the end of the edit."""


class LiveRegeneration:
    """Shows an edit in progress together with the traffic that reacts to it.

    Each preview of the edit asks for regenerated trajectories, which are shown as soon
    as they arrive; until then the last ones move with their agents. At the end of the
    gesture the trajectories are regenerated once more with the usual settings, and edit
    and trajectories become one undo step. Until that has arrived, another edit commits
    what is shown. All methods are called on the session's thread.
    """

    def __init__(
        self,
        session: EditorSession,
        post: Callable[[Callable[[], None], str | None], None],
        requests: Callable[[Scenario], LiveRequests | None],
        *,
        on_change: Callable[[], None] = lambda: None,
        on_end: Callable[[], None] = lambda: None,
        on_result: Callable[[GenerationRequest, GeneratedTraffic], None] = (
            lambda _request, _traffic: None
        ),
        on_error: Callable[[PdEditorError], None] = lambda _: None,
    ) -> None:
        """Make it idle.

        Args:
            session: the editing session.
            post: runs an action on the session's thread; of neighbours with equal keys
                only the newest.
            requests: returns what to generate for an edit, given the edited scenario;
                None if nothing reacts.
            on_change: called when ``is_refining`` has changed.
            on_end: called when a gesture was committed with its final trajectories.
            on_result: called with final trajectories before they are committed.
            on_error: called with an error of the generator, once per gesture.
        """
        self._session = session
        self._post = post
        self._requests = requests
        self._on_change = on_change
        self._on_end = on_end
        self._on_result = on_result
        self._on_error = on_error
        self._run = NewestRun()
        self._gesture: _Gesture | None = None

    @property
    def is_refining(self) -> bool:
        """Whether a gesture has ended and its final trajectories are being generated."""
        gesture = self._gesture
        return gesture is not None and gesture.is_over and self._is_current(gesture)

    def preview(self, edit: Command) -> None:
        """Preview an edit on the state at the gesture's start, with live traffic.

        Raises:
            EditError: the edit is not valid; the last preview stays.
        """
        start = self._session.committed_scenario
        edited = apply_within_locks(edit, start)
        gesture = self._begun(start, edited)
        if gesture is None:
            self._session.preview(edit)
            return
        gesture.edit, gesture.edited = edit, edited
        self._show(gesture)
        self._ask(gesture, gesture.requests.draft)

    def finish(self) -> bool:
        """End the gesture; returns whether final trajectories will commit it.

        Otherwise the caller commits it.
        """
        gesture = self._gesture
        if gesture is None or not self._is_current(gesture) or not gesture.reacts:
            self.drop()
            return False
        self._run.drop()
        gesture.is_over = True
        self._ask(gesture, gesture.requests.result)
        self._on_change()
        return True

    def drop(self) -> None:
        """Forget the gesture and cancel what is generated for it."""
        self._run.drop()
        was_refining, self._gesture = self.is_refining, None
        if was_refining:
            self._on_change()

    def close(self) -> None:
        """End the thread of the generator."""
        self.drop()
        self._run.close(CLOSE_WAIT_S)

    def _begun(self, start: Scenario, edited: Scenario) -> "_Gesture | None":
        """The gesture in progress, or a new one; None if nothing reacts."""
        gesture = self._gesture
        if gesture is not None and self._is_current(gesture) and not gesture.is_over:
            return gesture
        self.drop()
        requests = self._requests(edited)
        if requests is None:
            return None
        self._gesture = _Gesture(start=start, requests=requests)
        return self._gesture

    def _is_current(self, gesture: "_Gesture") -> bool:
        session = self._session
        return (
            gesture is self._gesture
            and (gesture.edit is None or session.state.is_previewing)
            and session.committed_scenario is gesture.start
        )

    def _ask(
        self, gesture: "_Gesture", make: Callable[[Scenario], GenerationRequest]
    ) -> None:
        if not gesture.reacts:
            return
        assert gesture.edited is not None
        request = replace(make(gesture.edited), before_edit=gesture.start)
        is_over = gesture.is_over
        self._run.ask(
            gesture.requests.generator,
            request,
            lambda traffic: self._post(
                partial(self._arrived, gesture, request, traffic, is_over), "live"
            ),
            lambda error: self._post(partial(self._failed, gesture, error), None),
        )

    def _arrived(
        self,
        gesture: "_Gesture",
        request: GenerationRequest,
        traffic: GeneratedTraffic,
        is_over: bool,
    ) -> None:
        if not self._is_current(gesture) or is_over != gesture.is_over:
            return
        gesture.traffic = traffic_command(request, traffic)
        self._show(gesture)
        if is_over:
            self._on_result(request, traffic)
            self._session.commit_gesture()
            self.drop()
            self._on_end()

    def _failed(self, gesture: "_Gesture", error: PdEditorError) -> None:
        if not self._is_current(gesture) or gesture.has_failed:
            return
        gesture.has_failed = True
        if gesture.is_over:
            self._session.commit_gesture()
            self.drop()
            self._on_end()
        self._on_error(error)

    def _show(self, gesture: "_Gesture") -> None:
        """Preview the newest edit with the newest trajectories."""
        edit, traffic = gesture.edit, gesture.traffic
        assert edit is not None
        assert gesture.edited is not None
        if traffic is not None and gesture.changes:
            sample = carried_to(traffic.sample, gesture.edited)
            edit = RegeneratedEdit(edit=edit, traffic=replace(traffic, sample=sample))
        self._session.preview(edit)


@dataclass(kw_only=True, eq=False)
class _Gesture:
    """An edit in progress."""

    start: Scenario
    requests: LiveRequests
    edit: Command | None = None
    edited: Scenario | None = None
    traffic: ReplaceTraffic | None = None
    """The newest trajectories."""
    is_over: bool = False
    """Whether the pointer has let go, and the final trajectories are awaited."""
    has_failed: bool = False

    @property
    def changes(self) -> bool:
        """Whether the edit has an effect."""
        return self.edited is not None and self.edited is not self.start

    @property
    def reacts(self) -> bool:
        """Whether traffic is generated for the edit."""
        return self.changes and not self.has_failed
