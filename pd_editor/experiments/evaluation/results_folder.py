"""Results folder of trials: rows of finished items, then of all items in one file."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.base.regular_file import unwritable
from pd_editor.experiments.evaluation.method import TrialItem
from pd_editor.experiments.evaluation.scene_rows import SceneRows
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkProgress,
    run_items,
)
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME, ResumableFolder

_METADATA_KEY: Final = b"pd_editor"


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResults:
    """What a run has, besides the file of all rows."""

    finished: Mapping[str, SceneRows]
    """Items with rows, which are left out here."""
    failures: Mapping[str, str]
    """Reasons of items without rows, by key."""
    num_resumed: int
    """Number of items that an earlier run had finished."""


class RowsFolder(ResumableFolder):
    """Results folder of trials that can be resumed."""

    def __init__(
        self,
        path: Path,
        settings: Mapping[str, Any],
        rows: tuple[str, pa.Schema],
        *,
        work: str,
        resume: bool,
    ) -> None:
        """Create the folder, or resume the one of an earlier run.

        ``rows`` are name and schema of the file of all rows.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a run with other settings.
        """
        super().__init__(path, settings, work=work, resume=resume)
        name, self.schema = rows
        self.rows_path = path / name

    def store(self, key: str, rows: SceneRows) -> None:
        """Store a finished item.

        Raises:
            ExportError: the file cannot be written.
        """
        about = {
            "failures": dict(rows.failures),
            "has_future": rows.has_future,
            "model_sha256": dict(rows.model_sha256),
        }
        metadata = {_METADATA_KEY: json.dumps(about).encode()}
        sink = pa.BufferOutputStream()
        pq.write_table(rows.table.replace_schema_metadata(metadata), sink)
        self.write(self._name(key), sink.getvalue().to_pybytes())

    def load(self, key: str, *, with_rows: bool = True) -> SceneRows | None:
        """Load a finished item; None if it is missing or unusable."""
        try:
            file = pq.ParquetFile(self.path / self._name(key))
            about = json.loads((file.schema_arrow.metadata or {})[_METADATA_KEY])
            if not file.schema_arrow.equals(self.schema):
                return None
            table = file.read() if with_rows else self.schema.empty_table()
        except (OSError, ValueError, KeyError):
            return None
        return SceneRows(table=table.replace_schema_metadata(None), **about)

    def finished(self, keys: Iterable[str]) -> frozenset[str]:
        """Keys of the items that are finished without failures, among some keys."""
        found = ((key, self.load(key, with_rows=False)) for key in keys)
        return frozenset(key for key, rows in found if rows and not rows.failures)

    def run(
        self,
        function: Callable[[Any], SceneRows],
        items: Mapping[str, TrialItem],
        engine: WorkEngine,
        *,
        on_progress: Callable[[WorkProgress], None] | None = None,
        on_rows: Callable[[pa.Table], None] = lambda _: None,
    ) -> RunResults:
        """Run unfinished items, and write the rows of all items in order.

        ``on_rows`` is called with the rows of each item that this run finishes.

        Raises:
            ExportError: the folder cannot be written.
        """
        done = self.finished(items)

        def store(key: str, rows: SceneRows) -> None:
            self.store(key, rows)
            on_rows(rows.table)

        failed = run_items(
            engine, function, items, on_value=store, on_progress=on_progress, done=done
        )
        reasons = {key: failure.reason for key, failure in failed.items()}
        finished: dict[str, SceneRows] = {}
        try:
            with pq.ParquetWriter(self.rows_path, self.schema) as writer:
                for key in items:
                    rows = None if key in reasons else self.load(key)
                    if rows is None:
                        reasons.setdefault(key, "Its finished file cannot be read.")
                        continue
                    writer.write_table(rows.table)
                    finished[key] = replace(rows, table=self.schema.empty_table())
        except OSError as error:
            raise unwritable(self.rows_path, error) from error
        return RunResults(finished=finished, failures=reasons, num_resumed=len(done))

    def _name(self, key: str) -> str:
        return f"{FINISHED_NAME}/{key}.parquet"
