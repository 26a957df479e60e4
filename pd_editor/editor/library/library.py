"""The library: starred scenarios, stored as folders on disk."""

import json
import logging
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pd_editor.base.errors import ExportError, InputError, RecipeError
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.editor.library.index_table import INDEX_NAME, IndexRow, index_csv
from pd_editor.scene.exporters.bundle import write_files, zip_folders

LIBRARY_NAME: Final = "library"
"""Folder of a library among the editor's own files."""
CARD_NAME: Final = "card.json"
"""File with what lists tell of a scenario; not part of it."""
KEPT_S: Final = 86_400.0
"""Time for which a removed scenario can be put back."""
_REMOVED: Final = ".removed"
_logger: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LibraryCard:
    """A starred scenario."""

    row: IndexRow
    saved_at: float
    """Time of starring, in seconds since 1970."""
    thumbnail: str = ""
    """Small picture of the scenario as SVG; empty without one."""

    @property
    def name(self) -> str:
        """Id of the scenario, and name of its folder."""
        return self.row.scenario_id


class Library:
    """A folder with one folder per starred scenario; a name is never taken twice.

    Tabs and processes may share it: entries are added and removed atomically.
    """

    def __init__(self, folder: Path) -> None:
        """Use a folder, which is created when needed."""
        self._folder = folder
        self._adding = threading.Lock()
        self._forget_removed()

    def has(self, name: str) -> bool:
        """Whether the name is taken."""
        return os.path.exists(self._folder / name)

    def card(self, name: str) -> LibraryCard | None:
        """A starred scenario; None if it is not in the library, or cannot be read."""
        try:
            content = json.loads((self._folder / name / CARD_NAME).read_bytes())
            # Pictures are longer than texts may be.
            picture = content.pop("thumbnail", "") if isinstance(content, dict) else ""
            entry = from_json(LibraryCard, content, "The entry")
            entry = replace(entry, thumbnail=str(picture))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError, RecipeError) as error:
            _logger.warning("%s in the library cannot be read: %s", name, error)
            return None
        return entry if entry.name == name else None

    def stamp(self) -> int:
        """A number that changes when another tab or process changes the library."""
        try:
            return self._folder.stat().st_mtime_ns
        except OSError:
            return 0

    def add(
        self,
        row: IndexRow,
        files: Mapping[str, bytes],
        *,
        saved_at: float,
        thumbnail: str = "",
        replaces: str | None = None,
    ) -> LibraryCard:
        """Add an exported scenario, in place of the one named ``replaces`` if any.

        Raises:
            ExportError: the name is taken, or the files cannot be written.
        """
        entry = LibraryCard(row=row, saved_at=saved_at, thumbnail=thumbnail)
        about = json.dumps(to_json(entry)).encode()
        with self._adding:
            write_files(
                {**files, CARD_NAME: about},
                self._folder / entry.name,
                forbidden=None,
                overwrite=entry.name == replaces,
            )
        if replaces not in (None, entry.name):
            shutil.rmtree(self._set_aside(replaces), ignore_errors=True)
        return entry

    def cards(self) -> list[LibraryCard]:
        """All starred scenarios, the oldest first."""
        found: list[LibraryCard] = []
        try:
            names = sorted(os.listdir(self._folder))
        except OSError:
            return []
        for name in names:
            entry = None if name.startswith(".") else self.card(name)
            if entry is not None:
                found.append(entry)
        return sorted(found, key=lambda entry: (entry.saved_at, entry.name))

    def remove(self, name: str) -> None:
        """Remove a scenario atomically; ``put_back`` restores it for a day.

        Raises:
            ExportError: the folder cannot be removed.
        """
        self._forget_removed()
        if self.card(name) is not None:
            self._set_aside(name)

    def put_back(self, name: str) -> None:
        """Restore the scenario that was removed last under a name.

        Raises:
            ExportError: it is gone, its name is taken by now, or it cannot be moved.
        """
        aside = [one for one in self._removed() if one.name.startswith(f".{name}.")]
        if not aside:
            raise ExportError(f"{name}: was removed for good.")
        with self._adding:
            if self.has(name):
                raise ExportError(
                    f"{name}: another scenario of the library has this name by now."
                )
            try:
                max(aside, key=_moment).rename(self._folder / name)
            except OSError as error:
                raise ExportError(
                    f"{name}: cannot be put back ({error.strerror})."
                ) from error

    def _set_aside(self, name: str) -> Path:
        """Move an entry to a hidden folder, whose time is the moment of removal."""
        gone = self._folder / f".{name}.{secrets.token_hex(4)}{_REMOVED}"
        try:
            os.utime(self._folder / name)
            (self._folder / name).rename(gone)
        except OSError as error:
            raise ExportError(
                f"{name}: cannot be removed ({error.strerror})."
            ) from error
        return gone

    def _removed(self) -> list[Path]:
        return list(self._folder.glob(f".*{_REMOVED}"))

    def _forget_removed(self) -> None:
        """Delete what was removed more than a day ago."""
        for folder in self._removed():
            if time.time() - _moment(folder) > KEPT_S:
                shutil.rmtree(folder, ignore_errors=True)

    def zipped(
        self,
        names: Collection[str],
        converted: Callable[[dict[str, bytes]], dict[str, bytes]] = lambda files: files,
    ) -> bytes:
        """Pack the folders of scenarios, converted, and a table of them into one zip.

        Raises:
            InputError: none of them is in the library, or one cannot be read.
        """
        wanted = [entry for entry in self.cards() if entry.name in names]
        if not wanted:
            raise InputError("The library holds none of these; star a scenario first.")
        folders = {one.name: converted(self._files(one.name)) for one in wanted}
        table = index_csv(entry.row for entry in wanted)
        return zip_folders(folders, {INDEX_NAME: table})

    def _files(self, name: str) -> dict[str, bytes]:
        try:
            return {
                path.name: path.read_bytes()
                for path in sorted((self._folder / name).iterdir())
                if path.name != CARD_NAME
            }
        except OSError as error:
            raise InputError(f"{name}: cannot be read ({error.strerror}).") from error


def _moment(folder: Path) -> float:
    """Time of a folder; that of one that is just being deleted is long ago."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0
