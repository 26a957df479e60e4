"""Formats that other packages bring: whatever their code raises becomes one sentence."""

import logging
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Final

from pd_editor.base.errors import ExportError, FormatError, InputError
from pd_editor.base.foreign_code import asked, origin_of
from pd_editor.base.plain_text import one_line
from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene
from pd_editor.scene.scenario import Scenario

_LOG: Final = logging.getLogger(__name__)


def foreign_format(point: EntryPoint) -> SceneFormat:
    """The format that an entry point names; of its faults, users see one sentence.

    Raises:
        InputError: it cannot be loaded, or is no format.
    """
    place = f"The format {point.name!r} ({origin_of(point)})"
    found = asked(
        lambda: _checked_format(point.load()), place, " cannot be loaded", InputError
    )

    def recognises(path: Path) -> bool:
        try:
            return asked(
                lambda: bool(found.recognises(path)),
                place,
                " did not say whether it knows a file",
                InputError,
            )
        except InputError as error:
            _told_once(str(error))
            return False

    def read(path: Path) -> Scenario:
        assert found.read is not None, "it can be read"
        return asked(
            lambda: _checked_scenario(found.read(path)),  # type: ignore[misc]
            str(path),
            f": {found.title} cannot be read",
            FormatError,
        )

    def write(scenario: Scenario) -> WrittenScene:
        return asked(
            lambda: _checked_files(found.write(scenario)),  # type: ignore[misc]
            scenario.scenario_id,
            f" cannot be written as {found.title}",
            ExportError,
        )

    return replace(
        found,
        recognises=recognises,
        read=found.read and read,
        write=found.write and write,
    )


@cache
def _told_once(what: str) -> None:
    """Tell it the first time, since all files of a folder may be asked for."""
    _LOG.warning("%s", what)


def _checked_format(found: object) -> SceneFormat:
    if not isinstance(found, SceneFormat):
        raise TypeError(f"it is a {type(found).__name__}; expected a SceneFormat")
    texts = found.name, found.title, *found.endings
    if isinstance(found.endings, str) or not all(
        isinstance(one, str) and one for one in texts
    ):
        raise TypeError(f"name, title and endings are {texts!r}; expected texts")
    return found


def _checked_scenario(found: object) -> Scenario:
    if not isinstance(found, Scenario):
        raise TypeError(f"read returned a {type(found).__name__}; expected a Scenario")
    return found


def _checked_files(found: object) -> WrittenScene:
    if not isinstance(found, WrittenScene):
        raise TypeError(
            f"write returned a {type(found).__name__}; expected a WrittenScene"
        )
    for name, data in found.files.items():
        if not isinstance(name, str) or not isinstance(data, bytes):
            raise TypeError(f"file {name!r} is a {type(data).__name__}; expected bytes")
    told = (found.losses,) if isinstance(found.losses, str) else found.losses
    return replace(found, losses=tuple(one_line(str(one)) for one in told))
