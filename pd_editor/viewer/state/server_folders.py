"""The gate to folders of the server's machine, which every field with a folder passes."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import ALL_DEMOS, DEMO_PREFIX, demo_names
from pd_editor.base.regular_file import user_path
from pd_editor.editor.variant import name_from_text

STUDIES_NAME: Final = "studies"


@dataclass(frozen=True, kw_only=True)
class ServerFolders:
    """Folders that a page may name: any, or only what the server offers to others."""

    is_local: bool
    """Whether only browsers of this machine can reach the editor."""
    state: Path
    """Folder of the editor's own files."""
    dataset_root: Path | None
    """Root of the dataset that the server offers."""

    def named(self, text: str) -> Path:
        """Any folder, to read or to write.

        Raises:
            InputError: the editor listens to other machines, or this is no path.
        """
        if not self.is_local:
            raise InputError(
                "Folders of the server's machine are closed while the editor listens "
                "to other machines (--host); upload and download instead."
            )
        return user_path(text)

    def scenes(self, text: str) -> Path:
        """A folder with scenarios; for other machines the demos or the dataset.

        Raises:
            InputError: it is none of these, or no path.
        """
        if self.is_local:
            return self.named(text)
        if self.dataset_root is not None and text == str(self.dataset_root):
            return self.dataset_root
        name = text.removeprefix(DEMO_PREFIX)
        if name not in (ALL_DEMOS, *demo_names()):
            dataset = f", or {self.dataset_root}" if self.dataset_root else ""
            raise InputError(
                "Other folders of the server's machine are closed while the editor "
                f"listens to other machines (--host); enter {ALL_DEMOS}, the name of a "
                f"demo{dataset}."
            )
        # A folder of this name in the server's working folder is not meant.
        return Path(f"{DEMO_PREFIX}{name}")

    def results(self, text: str) -> Path:
        """A folder for results; for other machines one of this name among the editor's files.

        Raises:
            InputError: this is no path, or no name.
        """
        # The server's folder is not the user's: name it as a whole.
        if self.is_local:
            return Path(os.path.realpath(self.named(text)))
        name = name_from_text(text)
        if not name:
            raise InputError("Name the results with letters or digits.")
        return Path(os.path.realpath(self.state)) / STUDIES_NAME / name
