"""Opens scenarios by the names users give, and writes them with their recipes."""

import dataclasses
from pathlib import Path
from typing import Final

from pd_editor.av2_io.read import read_scenario
from pd_editor.av2_io.write import scenario_files
from pd_editor.editor.recipe import Recipe
from pd_editor.errors import InputError
from pd_editor.exporters.bundle import write_files
from pd_editor.installed_files import demo_folder, demo_names
from pd_editor.scene.scenario import Scenario

DEMO_PREFIX: Final = "demo:"
RECIPE_NAME: Final = "recipe.json"


def open_scenario(reference: str | Path) -> Scenario:
    """The scenario that a user names: a demo, or an Argoverse 2 scenario folder.

    Raises:
        InputError: there is no such demo or folder, or it cannot be read.
    """
    text = str(reference)
    name = text.removeprefix(DEMO_PREFIX)
    if name in demo_names() and not Path(text).is_dir():
        scenario = read_scenario(demo_folder(name))
        provenance = dataclasses.replace(
            scenario.provenance, source=f"{DEMO_PREFIX}{name}"
        )
        return dataclasses.replace(scenario, provenance=provenance)
    folder = Path(text).expanduser()
    if not folder.is_dir():
        raise InputError(
            f"{text}: is neither a scenario folder nor a demo "
            f"({', '.join(demo_names())})."
        )
    return read_scenario(folder)


def exported_files(scenario: Scenario, recipe: Recipe) -> dict[str, bytes]:
    """The scenario as an Argoverse 2 folder's files, with the recipe that made it.

    Raises:
        ExportError: the scenario cannot be written, for example without agents.
    """
    return {**scenario_files(scenario), RECIPE_NAME: recipe.to_text().encode()}


def export_into(
    out: Path, name: str, scenario: Scenario, recipe: Recipe, *, overwrite: bool = False
) -> Path:
    """Write ``out/name`` with the exported files; the input is never overwritten.

    Raises:
        ExportError: the folder cannot be written, or holds something else.
    """
    folder = out / name
    source = scenario.provenance.source
    is_folder = bool(source) and not source.startswith(DEMO_PREFIX)
    write_files(
        exported_files(scenario, recipe),
        folder,
        forbidden=Path(source) if is_folder else None,
        overwrite=overwrite,
    )
    return folder
