"""The folder of a synthetic corpus: settings, finished networks, what they gave."""

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from pd_editor.errors import ExportError, InputError

SETTINGS_NAME: Final = "settings.json"
MANIFEST_NAME: Final = "manifest.json"
FINISHED_NAME: Final = "finished"


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


class CorpusFolder:
    """Files on disk; each is whole or not there at all."""

    def __init__(self, path: Path, settings: CorpusSettings, *, resume: bool) -> None:
        """Make the folder, or go on with the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: it was begun with other settings.
        """
        self.path = Path(path)
        self.settings = settings
        try:
            present = os.listdir(self.path) if os.path.lexists(self.path) else []
            if present:
                self._check_earlier(resume=resume)
            (self.path / FINISHED_NAME).mkdir(parents=True, exist_ok=True)
            self.write(SETTINGS_NAME, _json_bytes(asdict(settings)))
        except (OSError, ValueError) as error:
            raise _unwritable(self.path, error) from error

    def _check_earlier(self, *, resume: bool) -> None:
        if not resume:
            raise ExportError(
                f"{self.path}: already holds files; choose a new folder, or go on with "
                "an earlier run by --resume."
            )
        try:
            found = json.loads((self.path / SETTINGS_NAME).read_bytes())
        except (OSError, ValueError) as error:
            raise ExportError(
                f"{self.path}: holds no corpus to go on with (no readable "
                f"{SETTINGS_NAME}); choose a new folder."
            ) from error
        wanted = json.loads(_json_bytes(asdict(self.settings)))
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
            fresh.write_bytes(data)
            fresh.replace(target)
        except OSError as error:
            raise _unwritable(target, error) from error
        return target

    def store(self, key: str, record: NetworkRecord) -> None:
        """Keep that a network's files are written.

        Raises:
            ExportError: it cannot be written.
        """
        self.write(f"{FINISHED_NAME}/{key}.json", _json_bytes(asdict(record)))

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
        return self.write(MANIFEST_NAME, _json_bytes(manifest))


def write_scenario_folder(out: Path, name: str, files: Mapping[str, bytes]) -> None:
    """Write ``out/name``, whole or not at all; an equal one of before is replaced.

    Raises:
        ExportError: it cannot be written.
    """
    target, fresh = out / name, out / f".{name}.new"
    try:
        for old in (fresh, target):
            if old.exists():
                shutil.rmtree(old)
        fresh.mkdir()
        for file_name, data in files.items():
            (fresh / file_name).write_bytes(data)
        fresh.rename(target)
    except OSError as error:
        raise _unwritable(target, error) from error


def _json_bytes(value: Any) -> bytes:
    return json.dumps(value, indent=1).encode()


def _unwritable(path: Path, error: Exception) -> ExportError:
    reason = getattr(error, "strerror", None) or str(error)
    return ExportError(f"{path}: cannot be written ({reason}).")
