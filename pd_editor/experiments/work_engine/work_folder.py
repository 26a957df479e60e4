"""Results folders of long runs, which can be interrupted and resumed."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import ExportError, FolderInUseError, InputError
from pd_editor.base.regular_file import unwritable, write_whole
from pd_editor.experiments.work_engine.local_processes import end_unguarded_worker

SETTINGS_NAME: Final = "settings.json"
FINISHED_NAME: Final = "finished"


class WorkFolder:
    """Folder of a run; files are written atomically."""

    def __init__(self, path: Path) -> None:
        """Set the path of the folder; ``write`` creates it."""
        end_unguarded_worker()
        self.path = Path(path)

    def check_free(self) -> None:
        """Raise if the folder holds more than a run of which no item was finished.

        Raises:
            FolderInUseError: the folder holds files.
            ExportError: it is no folder.
        """
        names = self._names()
        if names == {SETTINGS_NAME, FINISHED_NAME}:
            names = self._names(FINISHED_NAME)
        if names:
            raise FolderInUseError(
                f"{self.path}: already holds files; choose a new folder, or resume "
                "the earlier run (--resume)."
            )

    def write(self, name: str, data: bytes) -> Path:
        """Write a file of the folder atomically.

        Raises:
            ExportError: the file cannot be written.
        """
        target = self.path / name
        write_whole(target, data)
        return target

    def write_json(self, name: str, values: Any) -> Path:
        """Write values as JSON; see ``write``."""
        return self.write(name, (json.dumps(values, indent=2) + "\n").encode())

    def _names(self, inside: str = "") -> set[str]:
        folder = self.path / inside
        try:
            return set(os.listdir(folder)) if os.path.lexists(folder) else set()
        except (OSError, ValueError) as error:
            raise unwritable(self.path, error) from error


class ResumableFolder(WorkFolder):
    """Finished parts on disk with their settings; the run can be resumed."""

    def __init__(
        self, path: Path, settings: Mapping[str, Any], *, work: str, resume: bool
    ) -> None:
        """Create the folder, or resume the one of an earlier run with equal settings.

        ``work`` is its name in messages, such as "evaluation".

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a run with other settings.
        """
        super().__init__(path)
        wanted = json.loads(json.dumps(settings))
        if not resume:
            self.check_free()
        elif self._names():
            self._check_earlier(wanted, work)
        try:
            (self.path / FINISHED_NAME).mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            raise unwritable(self.path, error) from error
        self.write_json(SETTINGS_NAME, wanted)

    def _check_earlier(self, wanted: dict[str, object], work: str) -> None:
        try:
            found = json.loads((self.path / SETTINGS_NAME).read_bytes())
        except (OSError, ValueError, RecursionError) as error:
            raise ExportError(
                f"{self.path}: holds no {work} to go on with (no readable "
                f"{SETTINGS_NAME}); choose a new folder."
            ) from error
        earlier = found if isinstance(found, dict) else {}
        other = [name for name in wanted if earlier.get(name) != wanted[name]]
        if other:
            raise InputError(
                f"{self.path}: was begun with other settings ({', '.join(other)}); use "
                "the same ones, or choose a new folder."
            )
