"""Formats that show a scene: films and figures."""

from functools import partial
from typing import Final

from pd_editor.scene.formats.figure import FigureLook, figure
from pd_editor.scene.formats.film import FilmLook, Told, film
from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene
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


def _write(ending: str, scenario: Scenario) -> WrittenScene:
    content = picture(scenario, ending, LOOKS[ending])
    return WrittenScene(files={f"{scenario.scenario_id}.{ending}": content})


def _title(ending: str) -> str:
    kind = "Figure" if isinstance(LOOKS[ending], FigureLook) else "Film"
    return f"{kind} ({ending.upper()})"


PICTURES: Final = tuple(
    SceneFormat(name=one, title=_title(one), write=partial(_write, one))
    for one in LOOKS
)
