"""Folder of a synthetic dataset: settings, finished networks and their records."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME, ResumableFolder
from pd_editor.scene.exporters.bundle import replace_folder

MANIFEST_NAME: Final = "manifest.json"


@dataclass(frozen=True, kw_only=True)
class NetworkRecord:
    """Record of one finished network."""

    num_windows: int
    num_agents: int
    """Number of agents in all windows at their current steps."""


@dataclass(frozen=True, kw_only=True)
class NetworkFiles:
    """Windows of one network as files, which the worker makes and the caller writes."""

    record: NetworkRecord
    shards: Mapping[str, bytes]
    folders: Mapping[str, Mapping[str, bytes]]
    """Files of scenario folders, by the folder's name and their own."""


class DatasetFolder(ResumableFolder):
    """Folder of a dataset that can be resumed."""

    def __init__(
        self, path: Path, settings: Mapping[str, Any], *, resume: bool
    ) -> None:
        """Create the folder, or resume the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a dataset with other settings.
        """
        self.settings = settings
        super().__init__(path, settings, work="dataset", resume=resume)

    def store(self, key: str, made: NetworkFiles) -> None:
        """Write the files of a network, then its record, with which it is finished.

        Raises:
            ExportError: a file cannot be written.
        """
        for name, data in made.shards.items():
            self.write(name, data)
        for name, files in made.folders.items():
            replace_folder(files, self.path / name)
        self.write_json(f"{FINISHED_NAME}/{key}.json", asdict(made.record))

    def load(self, key: str) -> NetworkRecord | None:
        """Record of a finished network; None if it is not finished."""
        try:
            found = json.loads((self.path / FINISHED_NAME / f"{key}.json").read_bytes())
            return NetworkRecord(**found)
        except (OSError, ValueError, TypeError, RecursionError):
            return None

    def write_manifest(self, networks: Mapping[str, NetworkRecord]) -> Path:
        """Write the dataset's settings and the records of its networks.

        Raises:
            ExportError: it cannot be written.
        """
        manifest = {
            **self.settings,
            "num_windows": sum(one.num_windows for one in networks.values()),
            "networks": {key: asdict(one) for key, one in networks.items()},
        }
        return self.write_json(MANIFEST_NAME, manifest)
