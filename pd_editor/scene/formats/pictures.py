"""Formats that show a scene: films and figures."""

from collections.abc import Callable, Iterator
from typing import Final

from pd_editor.scene.formats.figure import FigureLook, figure
from pd_editor.scene.formats.film import FilmLook, Told, film
from pd_editor.scene.formats.scene_format import (
    SceneFormat,
    WrittenScene,
    format_to_write,
)
from pd_editor.scene.scenario import Scenario

LOOKS: Final[dict[str, FigureLook | FilmLook]] = {
    "mp4": FilmLook(),
    "webm": FilmLook(),
    "gif": FilmLook(height_px=480),
    "pdf": FigureLook(),
    "svg": FigureLook(),
    "png": FigureLook(),
}
"""How a file of an ending looks unless told."""


def picture(
    scenario: Scenario,
    ending: str,
    look: FigureLook | FilmLook,
    on_progress: Told = lambda _done, _all: None,
) -> bytes:
    """Draw a film or a figure.

    Raises:
        ExportError: a moment, an agent or a size that cannot be drawn.
    """
    if isinstance(look, FigureLook):
        return figure(scenario, ending, look)
    return film(scenario, ending, look, on_progress)


def _write_as(ending: str) -> Callable[[Scenario], WrittenScene]:
    def write(scenario: Scenario) -> WrittenScene:
        content = picture(scenario, ending, LOOKS[ending])
        return WrittenScene(files={f"{scenario.scenario_id}.{ending}": content})

    return write


def _formats() -> Iterator[SceneFormat]:
    for ending, look in LOOKS.items():
        kind = "Figure" if isinstance(look, FigureLook) else "Film"
        yield format_to_write(ending, f"{kind} ({ending.upper()})", _write_as(ending))


PICTURES: Final = tuple(_formats())
