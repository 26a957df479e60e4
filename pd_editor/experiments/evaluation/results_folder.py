"""Results folder of an evaluation: finished scenes, then rows and reports."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.experiments.evaluation.scene_rows import ROW_SCHEMA, SceneRows
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME, ResumableFolder

_METADATA_KEY: Final = b"pd_editor"


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Settings that must be equal for finished scenes to be reused."""

    version: str
    """Version of the program, with which definitions may change."""
    data: tuple[str, ...]
    methods: tuple[str, ...]
    samples: int
    seed: int
    states: str = "recorded"
    agents: str = "all"
    current_s: float | None = None
    map_parts: tuple[str, ...] = ()


class EvaluationFolder(ResumableFolder):
    """Results folder of an evaluation that can be resumed."""

    def __init__(self, path: Path, settings: RunSettings, *, resume: bool) -> None:
        """Create the folder, or resume the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to an evaluation with other settings.
        """
        super().__init__(path, settings, work="evaluation", resume=resume)

    def store(self, key: str, rows: SceneRows) -> None:
        """Store a finished scene.

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
        """Load a finished scene; None if it is missing or unusable."""
        try:
            file = pq.ParquetFile(self.path / self._name(key))
            about = json.loads((file.schema_arrow.metadata or {})[_METADATA_KEY])
            if not file.schema_arrow.equals(ROW_SCHEMA):
                return None
            table = file.read() if with_rows else ROW_SCHEMA.empty_table()
        except (OSError, ValueError, KeyError):
            return None
        return SceneRows(
            table=table.replace_schema_metadata(None),
            failures=about["failures"],
            has_future=about["has_future"],
            model_sha256=about["model_sha256"],
        )

    def finished(self, keys: Mapping[str, object]) -> frozenset[str]:
        """Keys of the finished scenes among some keys."""
        done = set()
        for key in keys:
            rows = self.load(key, with_rows=False)
            if rows is not None and not rows.failures:
                done.add(key)
        return frozenset(done)

    def _name(self, key: str) -> str:
        return f"{FINISHED_NAME}/{key}.parquet"
