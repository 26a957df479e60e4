"""Background thread that generates traffic for the newest request only."""

import logging
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from typing import Final

from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    RunningGeneration,
    ScenarioGenerator,
)

LONGEST_GAP_S: Final = 0.1
"""Time without a result after which a run is completed although a newer one waits."""
WORTH_ITS_REST: Final = 0.5
"""Share of a run after which it is completed, because its result is near."""
_logger: Final = logging.getLogger(__name__)


@dataclass(kw_only=True, eq=False)
class _Run:
    generator: ScenarioGenerator
    request: GenerationRequest
    on_done: Callable[[GeneratedTraffic], None]
    on_error: Callable[[PdEditorError], None]
    is_dropped: threading.Event = field(default_factory=threading.Event)


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
        self._waiting: _Run | None = None
        self._running: _Run | None = None
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
        with self._changed:
            if self._is_closed:
                return
            self._waiting = _Run(
                generator=generator, request=request, on_done=on_done, on_error=on_error
            )
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
                self._running.is_dropped.set()

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
                run, self._waiting = self._waiting, None
                self._running = run
            assert run is not None
            self._complete(run)

    def _complete(self, run: _Run) -> None:
        try:
            traffic = self._result(run)
        except PdEditorError as error:
            self._fail(run, error)
        except Exception:
            _logger.exception("%s failed", run.generator.name)
            self._fail(
                run,
                GenerationError(
                    f"{run.generator.name} failed by a fault of its own; the log has"
                    " details."
                ),
            )
        else:
            if traffic is not None and not run.is_dropped.is_set():
                self._last_result_s = time.monotonic()
                run.on_done(traffic)

    def _result(self, run: _Run) -> GeneratedTraffic | None:
        """The traffic; None if cancelled."""
        with closing(run.generator.generate(run.request)) as steps:
            running = RunningGeneration(steps)
            for progress in running:
                if run.is_dropped.is_set() or self._is_obsolete(progress):
                    break
        return running.traffic

    def _is_obsolete(self, progress: GenerationProgress) -> bool:
        if progress.fraction >= WORTH_ITS_REST:
            return False
        with self._changed:
            is_newer_waiting = self._waiting is not None
        age_s = time.monotonic() - self._last_result_s
        return is_newer_waiting and age_s < LONGEST_GAP_S

    def _fail(self, run: _Run, error: PdEditorError) -> None:
        if not run.is_dropped.is_set():
            run.on_error(error)
