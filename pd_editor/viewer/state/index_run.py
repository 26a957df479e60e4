"""The index of a dataset or library for all tabs: what happens in its scenes."""

import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from threading import RLock
from typing import Final

from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.library.library import Library
from pd_editor.experiments.scene_index.index_file import SCHEMA, IndexWriter, SceneIndex
from pd_editor.experiments.work_engine.local_processes import (
    LocalProcesses,
    available_cores,
)
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkFailure,
    WorkProgress,
    progress_line,
)
from pd_editor.scene.formats.dataset import DatasetIndex

REFRESH_S: Final = 1.0
ENDING_PATIENCE_S: Final = 10.0


class IndexRun:
    """What is indexed by now, and the run that indexes the rest.

    Methods return at once; values change in the threads of its jobs.
    """

    def __init__(self, dataset: DatasetIndex | Library, file: Path) -> None:
        """Prepare it; ``look`` reads the file of the index."""
        self.dataset, self.file = dataset, file
        self.index = SceneIndex(folder=file.parent, table=SCHEMA.empty_table())
        """Scenes that can be found by now."""
        self.num_missing = 0
        """Number of scenes that are not in it, as far as that is known."""
        self.fraction: float | None = None
        """Share of a run that is done; None: none is running."""
        self.words = ""
        """How far a run is, or how it ended."""
        self.stamp = 0
        """Grows with every change."""
        self._job: _IndexJob | None = None
        self._lock = RLock()

    def look(self) -> None:
        """Find out what is indexed, once for all tabs."""
        with self._lock:
            if self._job is None:
                self._begin(None)

    def start(self) -> None:
        """Index what is missing, unless a run does; the picture keeps a core."""
        with self._lock:
            if self.fraction is None:
                self.fraction, self.words = 0.0, "Indexing ..."
                cores = max(available_cores() - 1, 1)
                self._begin(LocalProcesses(num_workers=cores))

    def cancel(self) -> None:
        """Cancel a run; what is indexed stays."""
        with self._lock:
            if self._job is not None and self.fraction is not None:
                self._job.cancel()
                self.fraction, self.words = None, "Cancelled; what is indexed stays."
                self._begin(None)

    def close(self) -> None:
        """Cancel a run, and wait until its file is written."""
        with self._lock:
            self.cancel()
            job = self._job
        if job is not None:
            job.wait(ENDING_PATIENCE_S)

    def show(
        self, job: "_IndexJob", writer: IndexWriter, progress: WorkProgress | None
    ) -> None:
        """Take what a job has indexed so far, unless another one has begun."""
        index = writer.index()
        with self._lock:
            if self._job is not job:
                return
            self.index, self.num_missing = index, writer.num_missing
            noun = "scenarios" if isinstance(self.dataset, Library) else "scenes"
            if progress is not None:
                self.fraction = progress.fraction
                told = progress_line(progress, job.elapsed_s, noun)
                self.words = f"Indexing: {told}."
            elif writer.is_broken and self.fraction is None:
                self.words = f"{self.file.name} cannot be read; it is to be made anew."
            self.stamp += 1

    def end(self, job: "_IndexJob", words: str | None) -> None:
        """Take how a job ended, unless another one has begun."""
        with self._lock:
            if self._job is job:
                self.fraction = None
                self.words = self.words if words is None else words
                self.stamp += 1

    def _begin(self, engine: WorkEngine | None) -> None:
        self._job = _IndexJob(self, self._job, engine)
        self._job.start()
        self.stamp += 1


class _IndexJob(BackgroundJob[Mapping[str, WorkFailure]]):
    """Finds out what the index lacks, and reads that if there is an engine."""

    def __init__(
        self, run: IndexRun, former: "_IndexJob | None", engine: WorkEngine | None
    ) -> None:
        """Prepare it; it waits for a former one, whose file it reads."""
        super().__init__(
            "index",
            lambda _job: self._indexed(),
            self._done,
            lambda error: run.end(self, str(error)),
            subject="The indexing",
        )
        self._index_run, self._former, self._engine = run, former, engine
        self._began = self._shown = 0.0

    @property
    def elapsed_s(self) -> float:
        """Time since it began to read."""
        return time.monotonic() - self._began

    def _indexed(self) -> Mapping[str, WorkFailure]:
        if self._former is not None:
            self._former.wait()
            self._former = None
        run = self._index_run
        writer = IndexWriter(run.file, map(str, run.dataset.scenes()))
        self._began = time.monotonic()
        run.show(self, writer, None)
        if self._engine is None:
            return {}
        return writer.read_missing(self._engine, partial(self._tell, writer))

    def _tell(self, writer: IndexWriter, progress: WorkProgress) -> None:
        self.check_cancelled()
        is_last = progress.num_done == progress.num_items
        if is_last or time.monotonic() - self._shown > REFRESH_S:
            self._shown = time.monotonic()
            self._index_run.show(self, writer, progress)

    def _done(self, failures: Mapping[str, WorkFailure]) -> None:
        told = f"{len(failures)} cannot be read." if failures else ""
        self._index_run.end(self, None if self._engine is None else told)
