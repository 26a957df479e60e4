"""Results folder of a study: finished items, then the rows of all variants."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.base.regular_file import unwritable
from pd_editor.experiments.studies.study_plan import StudySettings
from pd_editor.experiments.studies.variant_rows import (
    STUDY_AGENTS,
    VARIANT_SCHEMA,
    StudyItem,
    study_scene,
)
from pd_editor.experiments.work_engine import WorkEngine, run_items
from pd_editor.experiments.work_engine.work_engine import WorkProgress
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME, ResumableFolder

VARIANTS_NAME: Final = "variants.parquet"


class StudyFolder(ResumableFolder):
    """Results folder of a study that can be resumed."""

    def __init__(self, path: Path, settings: StudySettings, *, resume: bool) -> None:
        """Create the folder, or resume the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a study with other settings.
        """
        super().__init__(path, settings, work="study", resume=resume)

    def store(self, key: str, rows: pa.Table) -> None:
        """Store the rows of a finished item.

        Raises:
            ExportError: the file cannot be written.
        """
        sink = pa.BufferOutputStream()
        pq.write_table(rows, sink)
        self.write(self._name(key), sink.getvalue().to_pybytes())

    def load(self, key: str) -> pa.Table | None:
        """Load the rows of a finished item; None if they are missing or unusable."""
        try:
            rows = pq.read_table(self.path / self._name(key))
        except (OSError, ValueError):
            return None
        return rows if rows.schema.equals(VARIANT_SCHEMA) else None

    def finished(self, keys: Iterable[str]) -> frozenset[str]:
        """Keys of the items that are finished without failed variants."""
        found = ((key, self.load(key)) for key in keys)
        return frozenset(
            key
            for key, rows in found
            if rows is not None and rows["failure"].null_count == len(rows)
        )

    def _name(self, key: str) -> str:
        return f"{FINISHED_NAME}/{key}.parquet"


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyRecord:
    """Record of a run."""

    rows: pa.Table
    """Rows of all variants, in the order of the items."""
    failures: Mapping[str, str]
    """Reasons of items without rows, by key."""
    num_items: int
    num_resumed: int
    """Number of items that an earlier run had finished."""

    @property
    def num_failed_variants(self) -> int:
        """Number of variants without values."""
        failed = len(self.rows) - self.rows["failure"].null_count
        return failed // len(STUDY_AGENTS)


def run_study(
    items: Mapping[str, StudyItem],
    folder: StudyFolder,
    engine: WorkEngine,
    *,
    on_progress: Callable[[WorkProgress], None] | None = None,
    on_rows: Callable[[pa.Table], None] = lambda _: None,
) -> StudyRecord:
    """Run the unfinished items, and write ``variants.parquet`` of all items.

    ``on_rows`` is called with the rows of each item that this run finishes.

    Raises:
        ExportError: the folder cannot be written.
    """
    done = folder.finished(items)

    def store(key: str, rows: pa.Table) -> None:
        folder.store(key, rows)
        on_rows(rows)

    failures = run_items(
        engine, study_scene, items, on_value=store, on_progress=on_progress, done=done
    )
    reasons = {key: failure.reason for key, failure in failures.items()}
    target = folder.path / VARIANTS_NAME
    tables = [VARIANT_SCHEMA.empty_table()]
    try:
        with pq.ParquetWriter(target, VARIANT_SCHEMA) as writer:
            for key in items:
                rows = None if key in reasons else folder.load(key)
                if rows is None:
                    reasons.setdefault(key, "Its finished file cannot be read.")
                    continue
                writer.write_table(rows)
                tables.append(rows)
    except OSError as error:
        raise unwritable(target, error) from error
    return StudyRecord(
        rows=pa.concat_tables(tables),
        failures=reasons,
        num_items=len(items),
        num_resumed=len(done),
    )
