"""The folder of a synthetic corpus: settings, finished networks, what they gave."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from pd_editor.work_engine.work_folder import FINISHED_NAME, ResumableFolder

MANIFEST_NAME: Final = "manifest.json"


@dataclass(frozen=True, kw_only=True)
class CorpusSettings:
    """What must be equal for finished networks to be of use."""

    version: str
    """Of the program, since traffic may change."""
    num: int
    seed: int
    families: tuple[str, ...]
    maps: tuple[str, ...]
    """Roots of real maps, whose traffic is simulated in place of drawn networks."""
    form: str
    """``folders`` or ``shards``."""
    noise: bool


@dataclass(frozen=True, kw_only=True)
class NetworkRecord:
    """What one network gave."""

    num_windows: int
    num_agents: int
    """In all its windows at their current steps."""


class CorpusFolder(ResumableFolder):
    """What is there of a corpus."""

    def __init__(self, path: Path, settings: CorpusSettings, *, resume: bool) -> None:
        """Make the folder, or go on with the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: it was begun with other settings.
        """
        self.settings = settings
        super().__init__(path, settings, work="corpus", resume=resume)

    def store(self, key: str, record: NetworkRecord) -> None:
        """Keep that a network's files are written.

        Raises:
            ExportError: it cannot be written.
        """
        self.write_json(f"{FINISHED_NAME}/{key}.json", asdict(record))

    def load(self, key: str) -> NetworkRecord | None:
        """What a finished network gave; None if it is not finished."""
        try:
            found = json.loads((self.path / FINISHED_NAME / f"{key}.json").read_bytes())
            return NetworkRecord(**found)
        except (OSError, ValueError, TypeError):
            return None

    def write_manifest(self, networks: Mapping[str, NetworkRecord]) -> Path:
        """Write what the corpus is, and what each network gave.

        Raises:
            ExportError: it cannot be written.
        """
        manifest = {
            **asdict(self.settings),
            "num_windows": sum(one.num_windows for one in networks.values()),
            "networks": {key: asdict(one) for key, one in networks.items()},
        }
        return self.write_json(MANIFEST_NAME, manifest)
