"""What a format of scenes is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pd_editor.scene.scenario import Scenario


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
    endings: tuple[str, ...]
    """Endings of its files in lower case; empty if its scenes are folders."""
    recognises: Callable[[Path], bool]
    """Whether a path, also of a folder, holds this format, by its name and first bytes."""
    read: Callable[[Path], Scenario] | None = None
    """Reads a path; raises an ``InputError`` of one sentence."""
    write: Callable[[Scenario], WrittenScene] | None = None
    """Makes the files of a scene; raises an ``ExportError`` of one sentence."""


def format_to_write(
    name: str, title: str, write: Callable[[Scenario], WrittenScene]
) -> SceneFormat:
    """A format whose files are never read."""
    return SceneFormat(
        name=name, title=title, endings=(), recognises=lambda _path: False, write=write
    )
