"""What a format of scenes is."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.scene.formats.packed_file import head_of, unpacked_name
from pd_editor.scene.scenario import Scenario

IDS_NAME: Final = "ids.csv"


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenScene:
    """Files of a scene in some format."""

    files: Mapping[str, bytes]
    """Contents by file name, without folders."""
    losses: tuple[str, ...] = ()
    """One sentence for each part of the scene that the format cannot say."""


def losses_of(scenario: Scenario, *losses: str) -> tuple[str, ...]:
    """What a format without traffic signals cannot say of a scene, besides ``losses``."""
    return (
        (*losses, "Traffic signals and their states.") if scenario.signals else losses
    )


@dataclass(frozen=True, kw_only=True)
class SceneFormat:
    """A format of files that hold scenes; it reads them, writes them, or both.

    A format of one's own is a module-level value that the entry point group
    ``pd_editor.formats`` names.
    """

    name: str
    """For the shell, such as ``commonroad``."""
    title: str
    """For people, such as "CommonRoad"."""
    endings: tuple[str, ...] = ()
    """Endings of its files in lower case; empty if its scenes are folders."""
    recognises: Callable[[Path], bool] = lambda _path: False
    """Whether a path, also of a folder, holds this format, by its name and first bytes."""
    read: Callable[[Path], Scenario] | None = None
    """Reads a path; raises an ``InputError`` of one sentence."""
    write: Callable[[Scenario], WrittenScene] | None = None
    """Makes the files of a scene; raises an ``ExportError`` of one sentence."""


def has_root(root: str, *endings: str) -> Callable[[Path], bool]:
    """Tells whether a path has one of these endings, or is XML that begins with an element."""
    begin = re.compile(rf"<([\w.-]+:)?{root}[\s/>]".encode())

    def recognises(path: Path) -> bool:
        name = unpacked_name(path.name).lower()
        return name.endswith(endings) or (
            name.endswith(".xml") and begin.search(head_of(path)) is not None
        )

    return recognises
