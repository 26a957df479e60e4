"""Runs a generator in a background thread."""

from collections.abc import Callable, Generator
from contextlib import closing
from typing import TypeVar

from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.scene.generation import GenerationProgress

_Result = TypeVar("_Result")


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
