"""A whole study: variants, worst-case search, dangers, gallery and report; also in the background."""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import pyarrow as pa

from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.experiments.evaluation.evaluation import FoundScenes
from pd_editor.experiments.evaluation.scene_rows import RowsFolder, RunResults
from pd_editor.experiments.studies.outcomes import (
    AvoidableDanger,
    SearchItem,
    SearchSettings,
    WorstCase,
    dangers_of_part,
    grid_worst_cases,
    search_scene,
    severity_curves,
)
from pd_editor.experiments.studies.study_plan import (
    VARIANT_SCHEMA,
    StudyItem,
    StudyPlan,
    num_failed_variants,
    study_command,
    study_items,
    study_scene,
)
from pd_editor.experiments.studies.study_report import (
    GALLERY_NAME,
    GalleryEntry,
    StudyFindings,
    export_cases,
    export_danger,
    study_report,
    worst_of_scenes,
)
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkFailure,
    WorkProgress,
    run_items,
)
from pd_editor.scene.base_reference import SceneCut

WORK_ITEMS: Final = "work items"
"""What the variants of a study are worked on in."""
ProgressOf = Callable[[str], Callable[[WorkProgress], None]]
"""Makes the display of progress of work on items of a name."""


@dataclass(frozen=True, kw_only=True)
class StudyExtras:
    """What is done after the variants."""

    search: SearchSettings = field(default_factory=lambda: SearchSettings(num_trials=0))
    """Worst cases; without trials, those of the grid only."""
    num_worst: int = 6
    """Number of worst scenes that are exported."""
    num_dangers: int = 0
    """Number of dangerous but avoidable behaviours that are searched and exported."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Result of a study, and the files that were written."""

    folder: Path
    files: tuple[Path, ...]
    record: RunResults
    findings: StudyFindings
    methods: tuple[str, ...]

    def __str__(self) -> str:
        """One line per file, then notes on failures."""
        return "\n".join([*map(str, self.files), *self.remarks])

    @property
    def remarks(self) -> tuple[str, ...]:
        """One sentence for each kind of failure."""
        remarks = []
        if count := num_failed_variants(self.record.rows):
            remarks.append(f"{count} variants failed; the report says which and why.")
        if self.record.failures:
            remarks.append(f"{len(self.record.failures)} work items failed altogether.")
        failures = self.findings.failures
        if failures:
            where, error = next(iter(failures.items()))
            remarks.append(
                f"{len(failures)} searches and exports of scenes failed; the first is"
                f" {where}: {error}"
            )
        return tuple(remarks)

    def check_results(self) -> None:
        """Raise if a method succeeded on no variant, or a scene could not be written.

        Raises:
            PdEditorError: names the method or the place, and the reason.
        """
        rows = self.record.rows.select(["method", "failure"]).to_pylist()
        for name in self.methods:
            failures = [row["failure"] for row in rows if row["method"] == name]
            if None not in failures:
                reasons = [*failures, *self.record.failures.values()]
                reason = f" ({reasons[0].rstrip('.')})" if reasons else ""
                raise GenerationError(
                    f"{name}: failed on every variant, see {self.files[0]}{reason}."
                )
        for error in self.findings.failures.values():
            if isinstance(error.__cause__, OSError):
                raise error


def run_whole_study(
    plan: StudyPlan,
    extras: StudyExtras,
    found: FoundScenes,
    folder: RowsFolder,
    engine: WorkEngine,
    *,
    progress_of: ProgressOf,
    on_rows: Callable[[pa.Table], None] = lambda _: None,
) -> Study:
    """Run the variants and the searches, export the worst, write the report.

    ``on_rows`` is called with the rows of each finished item.

    Raises:
        ExportError: a file cannot be written.
    """
    items = study_items(plan, found.scenes)
    record = folder.run(
        study_scene,
        items,
        engine,
        on_progress=progress_of(WORK_ITEMS),
        on_rows=on_rows,
    )
    grid = grid_worst_cases(record.rows, extras.search)
    searched, failures = _searched(items, extras.search, engine, progress_of)
    gallery, unwritten = export_cases(
        worst_of_scenes((*grid, *searched), extras.num_worst),
        list(items.values()),
        folder.path / GALLERY_NAME,
    )
    dangers, missed = _dangers(
        found, plan.cut, folder, engine, extras.num_dangers, progress_of
    )
    findings = StudyFindings(
        curves=severity_curves(record.rows),
        grid=grid,
        search=searched,
        settings=extras.search,
        gallery=gallery,
        dangers=dangers,
        failures={**failures, **unwritten, **missed},
    )
    command = study_command(plan, folder.path)
    report = study_report(plan, record, findings, len(found.scenes), command)
    files = (*report.write(folder.path), folder.rows_path)
    return Study(
        folder=folder.path,
        files=files,
        record=record,
        findings=findings,
        methods=tuple(method.name for method in plan.methods),
    )


def _searched(
    items: dict[str, StudyItem],
    settings: SearchSettings,
    engine: WorkEngine,
    progress_of: ProgressOf,
) -> tuple[list[WorstCase], dict[str, PdEditorError]]:
    """Worst cases of the search, one for each scene, method and seed, and failures."""
    if not settings.num_trials:
        return [], {}
    by_scene = {(one.place, one.method.name, one.seed): one for one in items.values()}
    searches = {
        f"{item.split}/{place.name}/{method}/{seed}": SearchItem(
            variant=replace(item, conditions=()), settings=settings
        )
        for (place, method, seed), item in by_scene.items()
    }
    found: dict[str, WorstCase] = {}
    failures = run_items(
        engine,
        search_scene,
        searches,
        on_value=found.__setitem__,
        on_progress=progress_of("searches"),
    )
    return [found[key] for key in searches if key in found], _told("search", failures)


def _told(what: str, failures: Mapping[str, WorkFailure]) -> dict[str, PdEditorError]:
    return {
        f"{what}: {key}": GenerationError(failure.reason)
        for key, failure in failures.items()
    }


def _dangers(
    found: FoundScenes,
    times: SceneCut,
    folder: RowsFolder,
    engine: WorkEngine,
    count: int,
    progress_of: ProgressOf,
) -> tuple[tuple[GalleryEntry, ...], dict[str, PdEditorError]]:
    """The avoidable dangers with the hardest impacts over all scenes, and failures."""
    if not count:
        return (), {}
    by_scene: dict[str, tuple[AvoidableDanger, ...]] = {}
    parts = {one.key: (one.folder, one.cut(times)) for one in found.scenes}
    failed = run_items(
        engine,
        dangers_of_part,
        parts,
        on_value=by_scene.__setitem__,
        on_progress=progress_of("scenes searched for dangers"),
    )
    dangers = [(key, one) for key, dangers in by_scene.items() for one in dangers]
    dangers.sort(key=lambda pair: (-pair[1].impact_mps, pair[0], pair[1].agent_id))
    entries, failures = [], _told("dangers", failed)
    for key, danger in dangers[:count]:
        try:
            entries.append(
                export_danger(danger, *parts[key], folder.path / GALLERY_NAME)
            )
        except PdEditorError as error:
            failures[f"gallery: {key}, danger {danger.agent_id}"] = error
    return tuple(entries), failures


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
        super().__init__(
            "study",
            lambda _job: run_whole_study(
                plan,
                extras,
                found,
                folder,
                engine,
                progress_of=self._progress_of,
                on_rows=self._keep,
            ),
            on_done,
            on_error,
            subject="The study",
        )
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
