"""A study in the background, with progress, curves so far, and cancellation."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import pyarrow as pa

from pd_editor.base.errors import ExportError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.experiments.evaluation.evaluation import FoundScenes
from pd_editor.experiments.studies.study_folder import StudyFolder
from pd_editor.experiments.studies.study_plan import StudyPlan, study_command
from pd_editor.experiments.studies.variant_rows import VARIANT_SCHEMA
from pd_editor.experiments.studies.whole_study import (
    Study,
    StudyExtras,
    run_whole_study,
)
from pd_editor.experiments.work_engine import WorkEngine
from pd_editor.experiments.work_engine.work_engine import (
    WorkProgress,
    minutes_left,
    rate_in_words,
)

_logger: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class StudyProgress:
    """How far a study is."""

    noun: str
    """What is being worked on, such as "work items"."""
    num_done: int
    num_items: int
    num_failed: int
    elapsed_s: float
    """Since the work on these items began."""

    @property
    def fraction(self) -> float:
        """Share of the items that are done."""
        return self.num_done / max(self.num_items, 1)

    def in_words(self, variants_per_item: float = 0.0) -> str:
        """Number of finished items, rate and time left.

        ``variants_per_item`` makes it a rate of variants instead of items.
        """
        words = f"{self.num_done} of {self.num_items} {self.noun}"
        if self.num_failed:
            words += f", {self.num_failed} failed"
        if not 0 < self.num_done < self.num_items or self.elapsed_s <= 0:
            return words
        items_per_s = self.num_done / self.elapsed_s
        rate = rate_in_words(items_per_s)
        if variants_per_item:
            rate = rate_in_words(items_per_s * variants_per_item, "variants")
        left_s = (self.num_items - self.num_done) / items_per_s
        return f"{words}, {rate}, {minutes_left(left_s)}"


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
        folder: StudyFolder,
        engine: WorkEngine,
        *,
        on_progress: Callable[[StudyProgress], None],
        on_done: Callable[[Study], None],
        on_error: Callable[[PdEditorError], None],
    ) -> None:
        """Prepare the run; ``start`` starts it."""
        self._run_study = lambda: run_whole_study(
            plan,
            extras,
            found,
            folder,
            engine,
            study_command(plan, folder.path),
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
            self._on_progress(
                StudyProgress(
                    noun=noun,
                    num_done=progress.num_done,
                    num_items=progress.num_items,
                    num_failed=progress.num_failed,
                    elapsed_s=time.monotonic() - began,
                )
            )

        return tell

    def _keep(self, rows: pa.Table) -> None:
        self._rows.append(rows)

    def _result(self) -> Study | None:
        return self._run_study()

    def _fault(self) -> PdEditorError:
        return ExportError(
            "The study failed by a fault of its own; the log has details."
        )
