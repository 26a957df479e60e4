"""A study in the background, with progress, curves so far, and cancellation."""

import logging
import time
from collections.abc import Callable
from typing import Final

import pyarrow as pa

from pd_editor.base.errors import ExportError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.experiments.evaluation.evaluation import FoundScenes
from pd_editor.experiments.evaluation.results_folder import RowsFolder
from pd_editor.experiments.studies.study_plan import StudyPlan
from pd_editor.experiments.studies.variant_rows import VARIANT_SCHEMA
from pd_editor.experiments.studies.whole_study import (
    Study,
    StudyExtras,
    run_whole_study,
)
from pd_editor.experiments.work_engine.work_engine import WorkEngine, WorkProgress

_logger: Final = logging.getLogger(__name__)


class StudyJob(BackgroundJob[Study]):
    """One run of a study: progress, then exactly one of result and error.

    Callbacks are called from the job's thread, and none after ``cancel``, which stops
    running items. Finished items stay in the folder, so that a study can be resumed.
    """

    def __init__(
        self,
        plan: StudyPlan,
        extras: StudyExtras,
        found: FoundScenes,
        folder: RowsFolder,
        engine: WorkEngine,
        *,
        on_progress: Callable[[str, WorkProgress, float], None],
        on_done: Callable[[Study], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Prepare the run; ``start`` starts it.

        ``on_progress`` is called with what is worked on, such as "work items", how far
        that is, and the seconds since it began.
        """
        self._run_study = lambda: run_whole_study(
            plan,
            extras,
            found,
            folder,
            engine,
            progress_of=self._progress_of,
            on_rows=self._keep,
        )
        super().__init__("study", on_done, on_error)
        self._on_progress = on_progress
        self._rows: list[pa.Table] = []

    def rows(self) -> pa.Table:
        """Rows of the items that are finished so far."""
        return pa.concat_tables([VARIANT_SCHEMA.empty_table(), *self._rows])

    def _progress_of(self, noun: str) -> Callable[[WorkProgress], None]:
        began = time.monotonic()
        told: WorkProgress | None = None

        def tell(progress: WorkProgress) -> None:
            nonlocal told
            self.check_cancelled()
            if progress == told:
                return
            told = progress
            self._on_progress(noun, progress, time.monotonic() - began)

        return tell

    def _keep(self, rows: pa.Table) -> None:
        self._rows.append(rows)

    def _result(self) -> Study | None:
        return self._run_study()

    def _fault(self) -> PdEditorError:
        return ExportError(
            "The study failed by a fault of its own; the log has details."
        )
