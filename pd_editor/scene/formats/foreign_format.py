"""Formats that other packages bring: whatever their code raises becomes one sentence."""

import logging
from collections.abc import Collection
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Final, TypeVar

from pd_editor.base.errors import ExportError, FormatError, InputError
from pd_editor.base.foreign_code import asked, origin_of
from pd_editor.base.plain_text import one_line
from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene
from pd_editor.scene.scenario import Scenario

Value = TypeVar("Value")

_LOG: Final = logging.getLogger(__name__)


def foreign_format(point: EntryPoint, taken: Collection[str]) -> SceneFormat:
    """The format that an entry point names; of its faults, users see one sentence.

    Raises:
        InputError: it cannot be loaded, or is no format of a name that is not taken.
    """
    place = f"The format {point.name!r} ({origin_of(point)})"
    found = asked(
        lambda: _checked(point.load(), taken), place, " cannot be loaded", InputError
    )
    knows = found.recognises
    reads: Any = found.read
    writes: Any = found.write

    def recognises(path: Path) -> bool:
        told = " did not say whether it knows a file"
        try:
            return asked(lambda: bool(knows(path)), place, told, InputError)
        except InputError as error:
            _told_once(str(error))
            return False

    def read(path: Path) -> Scenario:
        told = f": {found.title} cannot be read"
        return asked(lambda: _a(Scenario, reads(path)), str(path), told, FormatError)

    def write(scenario: Scenario) -> WrittenScene:
        told, name = f" cannot be written as {found.title}", scenario.scenario_id
        return asked(lambda: _plain_files(writes(scenario)), name, told, ExportError)

    return replace(
        found, recognises=recognises, read=reads and read, write=writes and write
    )


@cache
def _told_once(what: str) -> None:
    """Tell it the first time, since all files of a folder may be asked for."""
    _LOG.warning("%s", what)


def _a(kind: type[Value], found: Any) -> Value:
    if not isinstance(found, kind):
        raise TypeError(f"got a {type(found).__name__}; expected a {kind.__name__}")
    return found


def _checked(found: Any, taken: Collection[str]) -> SceneFormat:
    if _a(SceneFormat, found).name in taken:
        raise ValueError(f"there is a format {found.name!r} already")
    for text in (found.name, found.title, *_a(tuple, found.endings)):
        _a(str, text)
    return found


def _plain_files(found: Any) -> WrittenScene:
    for name, data in _a(WrittenScene, found).files.items():
        _a(str, name)
        _a(bytes, data)
    losses = (found.losses,) if isinstance(found.losses, str) else found.losses
    return replace(found, losses=tuple(one_line(str(one)) for one in losses))
