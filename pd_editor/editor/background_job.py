"""Work in a thread, with one result or one error."""

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from contextlib import closing
from typing import Generic, TypeVar

from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.scene.generation import GenerationProgress

_logger = logging.getLogger(__name__)
_Result = TypeVar("_Result")


class Cancelled(Exception):
    """Ends a cancelled job from within a callback."""


class BackgroundJob(ABC, Generic[_Result]):
    """Work in a thread: exactly one of result and error, and none after ``cancel``.

    Callbacks are called from the job's thread.
    """

    def __init__(
        self,
        name: str,
        on_done: Callable[[_Result], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Prepare the work; ``start`` starts it."""
        self._name = name
        self._on_done = on_done
        self._on_error = on_error
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self.run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread; only once."""
        self._thread.start()

    def cancel(self) -> None:
        """Stop after the step in progress, without result or error."""
        self._cancelled.set()

    def check_cancelled(self) -> None:
        """End the work if it was cancelled; to be called within ``_result``."""
        if self._cancelled.is_set():
            raise Cancelled

    @property
    def is_running(self) -> bool:
        """Whether the thread is running."""
        return self._thread.is_alive()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until the thread ends."""
        self._thread.join(timeout_s)

    @abstractmethod
    def _result(self) -> _Result | None:
        """Do the work; None if cancelled."""

    @abstractmethod
    def _fault(self) -> PdEditorError:
        """Error for the user after a fault of the work's own code."""

    def run(self) -> None:
        """Do the work in this thread."""
        try:
            result = self._result()
        except Cancelled:
            pass
        except PdEditorError as error:
            self._fail(error)
        except Exception:
            _logger.exception("%s failed", self._name)
            self._fail(self._fault())
        else:
            if result is not None and not self._cancelled.is_set():
                self._on_done(result)

    def _fail(self, error: PdEditorError) -> None:
        if not self._cancelled.is_set():
            self._on_error(error)


class GenerationJob(BackgroundJob[_Result]):
    """One run of a generator: progress, then exactly one of result and error.

    Callbacks are called from the job's thread, and none after ``cancel``, which stops
    the generator after the step in progress.
    """

    def __init__(
        self,
        name: str,
        steps: Callable[[], Generator[GenerationProgress, None, _Result]],
        on_progress: Callable[[GenerationProgress], None],
        on_done: Callable[[_Result], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Prepare the run of a generator of some name; ``start`` starts it."""
        super().__init__(f"generate-{name}", on_done, on_error)
        self._generator = name
        self._steps = steps
        self._on_progress = on_progress

    def _result(self) -> _Result | None:
        with closing(self._steps()) as steps:
            while not self._cancelled.is_set():
                try:
                    progress = next(steps)
                except StopIteration as stop:
                    return stop.value
                if not self._cancelled.is_set():
                    self._on_progress(progress)
        return None

    def _fault(self) -> PdEditorError:
        return GenerationError(
            f"{self._generator} failed by a fault of its own; the log has details."
        )
