"""Runs a generator in a background thread."""

import logging
import threading
from collections.abc import Callable
from contextlib import closing
from typing import Final

from pd_editor.editor.commands.traffic import traffic_command
from pd_editor.errors import GenerationError, PdEditorError
from pd_editor.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    RunningGeneration,
    ScenarioGenerator,
)

__all__ = ["GenerationJob", "traffic_command"]

_logger: Final = logging.getLogger(__name__)


class GenerationJob:
    """One run of a generator: progress, then exactly one of result and error.

    Callbacks are called from the job's thread, and none after ``cancel``, which stops
    the generator after the step in progress.
    """

    def __init__(
        self,
        generator: ScenarioGenerator,
        request: GenerationRequest,
        on_progress: Callable[[GenerationProgress], None],
        on_done: Callable[[GeneratedTraffic], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Prepare the run; ``start`` starts it."""
        self._generator = generator
        self._request = request
        self._on_progress = on_progress
        self._on_done = on_done
        self._on_error = on_error
        self._cancelled = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"generate-{generator.name}", daemon=True
        )

    def start(self) -> None:
        """Start the thread; only once."""
        self._thread.start()

    def cancel(self) -> None:
        """Stop after the step in progress, without result or error."""
        self._cancelled.set()

    @property
    def is_running(self) -> bool:
        """Whether the thread is running."""
        return self._thread.is_alive()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until the thread ends."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            traffic = self._result()
        except PdEditorError as error:
            self._fail(error)
        except Exception:
            _logger.exception("%s failed", self._generator.name)
            self._fail(
                GenerationError(
                    f"{self._generator.name} failed by a fault of its own; the log"
                    " has details."
                )
            )
        else:
            if traffic is not None and not self._cancelled.is_set():
                self._on_done(traffic)

    def _result(self) -> GeneratedTraffic | None:
        """The traffic; None if cancelled."""
        with closing(self._generator.generate(self._request)) as steps:
            running = RunningGeneration(steps)
            for progress in running:
                if not self._cancelled.is_set():
                    self._on_progress(progress)
                if self._cancelled.is_set():
                    break
        return running.traffic

    def _fail(self, error: PdEditorError) -> None:
        if not self._cancelled.is_set():
            self._on_error(error)
