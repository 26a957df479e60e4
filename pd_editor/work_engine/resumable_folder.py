"""A folder of long work that can be interrupted and taken up again."""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pd_editor.errors import ExportError, InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

SETTINGS_NAME: Final = "settings.json"
FINISHED_NAME: Final = "finished"


class ResumableFolder:
    """Finished parts on disk, with the settings they hold for; each file is whole."""

    def __init__(
        self, path: Path, settings: "DataclassInstance", *, work: str, resume: bool
    ) -> None:
        """Make the folder, or go on with the one of an earlier run.

        Args:
            path: the folder.
            settings: what must be equal for finished parts to be of use.
            work: what the folder is of, in a word: "evaluation".
            resume: whether to go on with what is there.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: it was begun with other settings.
        """
        self.path = Path(path)
        wanted = json.dumps(asdict(settings), indent=2)
        try:
            present = os.listdir(self.path) if os.path.lexists(self.path) else []
            if present and not resume:
                raise ExportError(
                    f"{self.path}: already holds files; choose a new folder, or go on "
                    "with an earlier run by --resume."
                )
            if present:
                self._check_earlier(json.loads(wanted), work)
            (self.path / FINISHED_NAME).mkdir(parents=True, exist_ok=True)
            self.write(SETTINGS_NAME, wanted.encode())
        except (OSError, ValueError) as error:
            raise unwritable(self.path, error) from error

    def _check_earlier(self, wanted: dict[str, object], work: str) -> None:
        try:
            found = json.loads((self.path / SETTINGS_NAME).read_bytes())
        except (OSError, ValueError) as error:
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
            raise unwritable(target, error) from error
        return target


def unwritable(path: Path, error: Exception) -> ExportError:
    """What to tell the user of a file that cannot be written."""
    reason = getattr(error, "strerror", None) or str(error)
    return ExportError(f"{path}: cannot be written ({reason}).")
