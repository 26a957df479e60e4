"""Runs a generator in a background thread."""

from collections.abc import Callable
from contextlib import closing

from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.commands.traffic import traffic_command
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    RunningGeneration,
    ScenarioGenerator,
)

__all__ = ["GenerationJob", "traffic_command"]


class GenerationJob(BackgroundJob[GeneratedTraffic]):
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
        super().__init__(f"generate-{generator.name}", on_done, on_error)
        self._generator = generator
        self._request = request
        self._on_progress = on_progress

    def _result(self) -> GeneratedTraffic | None:
        with closing(self._generator.generate(self._request)) as steps:
            running = RunningGeneration(steps)
            for progress in running:
                if not self._cancelled.is_set():
                    self._on_progress(progress)
                if self._cancelled.is_set():
                    break
        return running.traffic

    def _fault(self) -> PdEditorError:
        return GenerationError(
            f"{self._generator.name} failed by a fault of its own; the log has details."
        )
