"""Argoverse 2 motion forecasting scenarios: folders of a track file and a map."""

from pathlib import Path
from typing import Final

from pd_editor.scene.av2_io.file_names import is_tracks_name
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.formats.scene_format import (
    SceneFormat,
    WrittenScene,
    losses_of,
    parts_of,
)
from pd_editor.scene.scenario import Scenario


def _recognises(path: Path) -> bool:
    try:
        return any(is_tracks_name(one.name) for one in path.iterdir())
    except OSError:
        return False


def _write(scenario: Scenario) -> WrittenScene:
    losses = losses_of(scenario, keeps=parts_of(scenario).keys() - {"signals"})
    return WrittenScene(files=scenario_files(scenario), losses=losses)


ARGOVERSE2: Final = SceneFormat(
    name="av2",
    title="Argoverse 2",
    recognises=_recognises,
    read=read_scenario,
    write=_write,
)
