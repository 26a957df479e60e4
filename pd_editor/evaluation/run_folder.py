"""The folder of an evaluation: finished scenes as they come, then rows and reports."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.errors import ExportError, InputError
from pd_editor.evaluation.scene_rows import ROW_SCHEMA, SceneRows

SETTINGS_NAME: Final = "settings.json"
FINISHED_NAME: Final = "finished"
_METADATA_KEY: Final = b"pd_editor"


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """What must be equal for finished scenes to be of use."""

    version: str
    """Of the program, since definitions may change."""
    data: tuple[str, ...]
    methods: tuple[str, ...]
    samples: int
    seed: int


class RunFolder:
    """Finished scenes on disk; each file is whole or not there at all."""

    def __init__(self, path: Path, settings: RunSettings, *, resume: bool) -> None:
        """Make the folder, or go on with the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: it was begun with other settings.
        """
        self.path = Path(path)
        try:
            present = os.listdir(self.path) if os.path.lexists(self.path) else []
            if present:
                self._check_earlier(settings, resume=resume)
            (self.path / FINISHED_NAME).mkdir(parents=True, exist_ok=True)
            self.write(SETTINGS_NAME, json.dumps(asdict(settings), indent=2).encode())
        except (OSError, ValueError) as error:
            raise _unwritable(self.path, error) from error

    def _check_earlier(self, settings: RunSettings, *, resume: bool) -> None:
        if not resume:
            raise ExportError(
                f"{self.path}: already holds files; choose a new folder, or go on with "
                "an earlier run by --resume."
            )
        try:
            found = json.loads((self.path / SETTINGS_NAME).read_bytes())
        except (OSError, ValueError) as error:
            raise ExportError(
                f"{self.path}: holds no evaluation to go on with (no readable "
                f"{SETTINGS_NAME}); choose a new folder."
            ) from error
        wanted = json.loads(json.dumps(asdict(settings)))
        earlier = found if isinstance(found, dict) else {}
        other = [name for name in wanted if earlier.get(name) != wanted[name]]
        if other:
            raise InputError(
                f"{self.path}: was begun with other settings ({', '.join(other)}); use "
                "the same ones, or choose a new folder."
            )

    def write(self, name: str, data: bytes) -> Path:
        """Write a file of the folder, whole or not at all.

        Raises:
            ExportError: it cannot be written.
        """
        target = self.path / name
        fresh = target.with_name(f".{target.name}.new")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            fresh.write_bytes(data)
            fresh.replace(target)
        except OSError as error:
            raise _unwritable(target, error) from error
        return target

    def store(self, key: str, rows: SceneRows) -> None:
        """Keep a finished scene.

        Raises:
            ExportError: it cannot be written.
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
        """A finished scene; None if it is not there, or of no use."""
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
        """Those of the keys whose scenes need no further work."""
        done = set()
        for key in keys:
            rows = self.load(key, with_rows=False)
            if rows is not None and not rows.failures:
                done.add(key)
        return frozenset(done)

    def _name(self, key: str) -> str:
        return f"{FINISHED_NAME}/{key}.parquet"


def _unwritable(path: Path, error: Exception) -> ExportError:
    reason = getattr(error, "strerror", None) or str(error)
    return ExportError(f"{path}: cannot be written ({reason}).")
