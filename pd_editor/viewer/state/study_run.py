"""The perturbation study of a workspace, which goes on while its page is reloaded."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from pd_editor.base.errors import PdEditorError
from pd_editor.experiments.evaluation.evaluation import FoundScenes
from pd_editor.experiments.evaluation.scene_rows import RowsFolder
from pd_editor.experiments.studies.outcomes import SeverityCurve, severity_curves
from pd_editor.experiments.studies.study_plan import StudyPlan, study_items
from pd_editor.experiments.studies.whole_study import (
    WORK_ITEMS,
    Study,
    StudyExtras,
    StudyJob,
)
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import WorkProgress, progress_line


class StudyRun:
    """Settings, progress and results of a study; a page that is made anew shows them.

    Progress and results come from the study's own thread. All other methods are those of
    the page's worker.
    """

    def __init__(self) -> None:
        """Without a study."""
        self.settings: dict[str, Any] = {}
        """Values of the page's fields that the user has changed, by name."""
        self.curves: tuple[SeverityCurve, ...] = ()
        self.methods: tuple[str, ...] = ()
        """Names of the methods in the order asked for."""
        self.fraction = 0.0
        """Finished share of the work."""
        self.words: tuple[str, ...] = ()
        """How far the study is, or how it ended."""
        self.study: Study | None = None
        """The last study, if it is done."""
        self.on_change: Callable[[], None] | None = None
        """Called from any thread when something is new; None while there is no page."""
        self._error: PdEditorError | None = None
        self._job: StudyJob | None = None
        self._curves_at = self._began = 0.0
        self._variants_per_item = self._grid_share = 1.0

    @property
    def is_running(self) -> bool:
        """Whether a study is running."""
        return self._job is not None

    def start(
        self,
        plan: StudyPlan,
        extras: StudyExtras,
        found: FoundScenes,
        folder: RowsFolder,
    ) -> None:
        """Start a study; there must be none that is running."""
        assert self._job is None, "one study at a time"
        self.curves, self.study, self.fraction = (), None, 0.0
        self._began = time.monotonic()
        self.methods = tuple(method.name for method in plan.methods)
        num_conditions = len(plan.conditions)
        self._grid_share = num_conditions / (num_conditions + extras.search.num_trials)
        per_scene = plan.num_variants(1)
        self._variants_per_item = per_scene / len(study_items(plan, found.scenes[:1]))
        count = len(found.scenes)
        self.words = (f"{plan.num_variants(count)} variants of {count} scenes ...",)
        self._job = StudyJob(
            plan,
            extras,
            found,
            folder,
            LocalProcesses(),
            on_progress=self._progressed,
            on_done=self._finished,
            on_error=self._failed,
        )
        self._job.start()
        self._changed()

    def cancel(self) -> None:
        """Cancel a running study; what is finished stays in its folder."""
        if self._job is not None:
            self._job.cancel()
            self._end(("Cancelled. Finished items stay; Resume goes on.",))

    def take_error(self) -> PdEditorError | None:
        """The error with which the study ended; None once it has been taken."""
        error, self._error = self._error, None
        return error

    def _progressed(self, noun: str, progress: WorkProgress, elapsed_s: float) -> None:
        job = self._job
        if job is None:
            return
        is_grid, share = noun == WORK_ITEMS, self._grid_share
        start, end = (0.0, share) if is_grid else (share, 1.0)
        self.fraction = start + (end - start) * progress.fraction
        per_item = self._variants_per_item if is_grid else 0.0
        text = progress_line(progress, elapsed_s, noun, per_item)
        self.words = (f"{text}.",)
        now = time.monotonic()
        if now - self._curves_at > 1.0:
            self._curves_at = now
            self.curves = severity_curves(job.rows())
        self._changed()

    def _finished(self, study: Study) -> None:
        self.study = study
        self.curves = tuple(study.findings.curves)
        took = time.monotonic() - self._began
        done = f"Done in {took:.0f} s."
        self._end((done, *study.remarks, f"Results: {study.folder}"))

    def _failed(self, error: PdEditorError) -> None:
        self._error = error
        self._end(())

    def _end(self, words: Sequence[str]) -> None:
        self._job, self.words = None, tuple(words)
        self._changed()

    def _changed(self) -> None:
        tell = self.on_change
        if tell is not None:
            tell()
