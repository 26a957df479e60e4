"""The basket: starred scenarios, stored as folders on disk."""

import json
import logging
import os
import secrets
import shutil
import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.basket.index_table import INDEX_NAME, IndexRow, index_csv
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.errors import ExportError, InputError, RecipeError
from pd_editor.exporters.bundle import write_files, zip_folders

ENTRY_NAME: Final = "entry.json"
"""File with an entry's summary for lists; not part of the scenario."""
_logger: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class BasketEntry:
    """A starred scenario."""

    row: IndexRow
    starred_at: float
    """Time of starring, in seconds since 1970."""
    thumbnail: str = ""
    """Small picture of the scenario as SVG; empty without one."""

    @property
    def name(self) -> str:
        """Id of the scenario, and name of its folder."""
        return self.row.scenario_id


class Basket:
    """A folder with one folder per starred scenario; entries are never replaced.

    Tabs and processes may share it: entries are added and removed atomically.
    """

    def __init__(self, folder: Path) -> None:
        """Use a folder, which is created when needed."""
        self._folder = folder
        self._adding = threading.Lock()

    def has(self, name: str) -> bool:
        """Whether the name is taken."""
        return (self._folder / name).exists()

    def add(
        self,
        row: IndexRow,
        files: Mapping[str, bytes],
        *,
        starred_at: float,
        thumbnail: str = "",
    ) -> BasketEntry:
        """Add an exported scenario.

        Raises:
            ExportError: the name is taken, or the files cannot be written.
        """
        entry = BasketEntry(row=row, starred_at=starred_at, thumbnail=thumbnail)
        about = json.dumps(to_json(entry)).encode()
        with self._adding:
            write_files(
                {**files, ENTRY_NAME: about}, self._folder / entry.name, forbidden=None
            )
        return entry

    def entries(self) -> list[BasketEntry]:
        """All starred scenarios, the oldest first."""
        found: list[BasketEntry] = []
        try:
            names = sorted(os.listdir(self._folder))
        except OSError:
            return []
        for name in names:
            if name.startswith("."):
                continue
            try:
                content = json.loads((self._folder / name / ENTRY_NAME).read_bytes())
                entry = from_json(BasketEntry, content, "The entry")
            except (OSError, ValueError, RecipeError) as error:
                _logger.warning("%s in the basket cannot be read: %s", name, error)
                continue
            if entry.name == name:
                found.append(entry)
        return sorted(found, key=lambda entry: (entry.starred_at, entry.name))

    def remove(self, name: str) -> None:
        """Remove a scenario permanently and atomically.

        Raises:
            ExportError: the folder cannot be removed.
        """
        if name not in {entry.name for entry in self.entries()}:
            return
        gone = self._folder / f".{name}.{secrets.token_hex(4)}.old"
        try:
            (self._folder / name).rename(gone)
        except OSError as error:
            raise ExportError(
                f"{name}: cannot be removed ({error.strerror})."
            ) from error
        shutil.rmtree(gone, ignore_errors=True)

    def zipped(self, names: Collection[str]) -> bytes:
        """Pack the folders of scenarios and a table of them into one zip.

        Raises:
            InputError: none of them is in the basket, or one cannot be read.
        """
        wanted = [entry for entry in self.entries() if entry.name in names]
        if not wanted:
            raise InputError("The basket holds none of these; star a scenario first.")
        folders = {entry.name: self._files(entry.name) for entry in wanted}
        table = index_csv(entry.row for entry in wanted)
        return zip_folders(folders, {INDEX_NAME: table})

    def _files(self, name: str) -> dict[str, bytes]:
        try:
            return {
                path.name: path.read_bytes()
                for path in sorted((self._folder / name).iterdir())
                if path.name != ENTRY_NAME
            }
        except OSError as error:
            raise InputError(f"{name}: cannot be read ({error.strerror}).") from error
