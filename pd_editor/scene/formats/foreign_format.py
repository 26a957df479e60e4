"""Formats that other packages bring: whatever their code raises becomes one sentence."""

import logging
import os
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

from pd_editor.base.errors import ExportError, FormatError, InputError, LargeSceneError
from pd_editor.base.foreign_code import asked
from pd_editor.base.plain_text import one_line
from pd_editor.scene.formats.packed_file import PACKED, unpacked_file
from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene
from pd_editor.scene.scenario import Scenario

Value = TypeVar("Value")

_LOG: Final = logging.getLogger(__name__)


def foreign_format(
    load: Callable[[], Any], place: str, taken: Collection[str]
) -> SceneFormat:
    """The format that is loaded from a place; of its faults, users see one sentence.

    Raises:
        InputError: it cannot be loaded, or is no format of a name that is not taken.
    """
    found = asked(
        lambda: _checked(load(), taken), place, " cannot be loaded", InputError
    )
    knows = found.recognises
    reads: Any = found.read
    writes: Any = found.write
    packed = tuple(f"{ending}{PACKED}" for ending in found.endings)

    def recognises(path: Path) -> bool:
        told = " did not say whether it knows a file"

        def known() -> bool:
            if knows(path):
                return True
            if not path.name.lower().endswith(packed):
                return False
            # Most are known without links to a whole folder.
            for is_alone in (True, False):
                with unpacked_file(path, is_alone=is_alone) as plain:
                    if knows(plain):
                        return True
            return False

        try:
            return asked(known, place, told, InputError)
        except InputError as error:
            _told_once(str(error))
            return False

    def read(path: Path) -> Scenario:
        told = f": {found.title} cannot be read"

        def found_in() -> Scenario:
            # Who knows gzipped files reads them; all others get them unpacked.
            if knows(path):
                return _a(Scenario, reads(path))
            with unpacked_file(path) as plain:
                return _a(Scenario, _named(reads, plain, path))

        return asked(found_in, str(path), told, FormatError)

    def write(scenario: Scenario) -> WrittenScene:
        told, name = f" cannot be written as {found.title}", scenario.scenario_id
        return asked(lambda: _plain_files(writes(scenario)), name, told, ExportError)

    return replace(
        found, recognises=recognises, read=reads and read, write=writes and write
    )


def _named(read: Callable[[Path], Any], plain: Path, path: Path) -> Any:
    """What is read of an unpacked file, with the name of the packed one in what is told."""

    def renamed(error: InputError) -> str:
        told = str(error).replace(str(plain), str(path))
        return told.replace(str(plain.parent), str(path.parent))

    try:
        found = read(plain)
    except LargeSceneError as error:
        scene = replace(error.scene, path=path)
        raise type(error)(renamed(error), scene, error.data) from error
    except InputError as error:
        raise FormatError(renamed(error)) from error
    if not isinstance(found, Scenario):
        return found
    return found.with_origin(source=os.path.realpath(path))


@cache
def _told_once(what: str) -> None:
    """Tell it the first time, since all files of a folder may be asked for."""
    _LOG.warning("%s", what)


def _a(kind: type[Value], found: Any, what: str = "") -> Value:
    if not isinstance(found, kind):
        got = f"{what}got a {type(found).__name__}"
        raise TypeError(f"{got}; expected a {kind.__name__}")
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
        _a(bytes, data, f"file {name!r}: ")
    losses = (found.losses,) if isinstance(found.losses, str) else found.losses
    return replace(found, losses=tuple(one_line(str(one)) for one in losses))
