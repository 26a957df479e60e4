"""Work in a thread, with one result or one error."""

import logging
import threading
from collections.abc import Callable, Generator
from contextlib import closing
from typing import Any, Generic, TypeVar

from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.scene.generation import GenerationProgress

_logger = logging.getLogger(__name__)
_Result = TypeVar("_Result")


class Cancelled(Exception):
    """Ends a cancelled job from within a callback."""


class BackgroundJob(Generic[_Result]):
    """Work in a thread: exactly one of result and error, and none after ``cancel``.

    Callbacks are called from the job's thread.
    """

    def __init__(
        self,
        name: str,
        work: Callable[["BackgroundJob[Any]"], _Result | None],
        on_done: Callable[[_Result], None],
        on_error: Callable[[PdEditorError], None],
        *,
        subject: str = "The work",
        fault: type[PdEditorError] = PdEditorError,
    ) -> None:
        """Prepare the work, which is given the job; ``start`` starts it.

        It returns None once it is cancelled. ``subject`` begins the sentence, and
        ``fault`` is the kind, of the error that its own code's faults become.
        """
        self._name, self._work = name, work
        self._subject, self._fault = subject, fault
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

    def is_cancelled(self) -> bool:
        """Whether the work is to end."""
        return self._cancelled.is_set()

    def check_cancelled(self) -> None:
        """End the work if it was cancelled; to be called by the work."""
        if self._cancelled.is_set():
            raise Cancelled

    @property
    def is_running(self) -> bool:
        """Whether the thread is running."""
        return self._thread.is_alive()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until the thread ends."""
        self._thread.join(timeout_s)

    def run(self) -> None:
        """Do the work in this thread."""
        try:
            result = self._work(self)
        except Cancelled:
            pass
        except PdEditorError as error:
            self._fail(error)
        except Exception:
            _logger.exception("%s failed", self._name)
            self._fail(
                self._fault(
                    f"{self._subject} failed by a fault of its own; the log has details."
                )
            )
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

        def work(job: BackgroundJob[Any]) -> _Result | None:
            with closing(steps()) as left:
                while not job.is_cancelled():
                    try:
                        progress = next(left)
                    except StopIteration as stop:
                        return stop.value
                    if not job.is_cancelled():
                        on_progress(progress)
            return None

        super().__init__(
            f"generate-{name}",
            work,
            on_done,
            on_error,
            subject=name,
            fault=GenerationError,
        )
