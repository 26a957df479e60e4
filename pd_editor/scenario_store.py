"""Opens scenarios by the names users give, and writes them with their recipes."""

import dataclasses
import os
from pathlib import Path
from typing import Final

from pd_editor.av2_io.file_names import map_name, tracks_name
from pd_editor.av2_io.read import read_scenario
from pd_editor.av2_io.write import scenario_files
from pd_editor.editor.recipe import Recipe
from pd_editor.errors import ExportError, InputError
from pd_editor.exporters.bundle import RECIPE_NAME, check_place, write_files
from pd_editor.installed_files import demo_folder, demo_names
from pd_editor.regular_file import check_path
from pd_editor.scene.focal_agent import with_focal_category
from pd_editor.scene.scenario import Scenario

DEMO_PREFIX: Final = "demo:"


def open_scenario(reference: str | Path) -> Scenario:
    """The scenario that a user names: a demo, or an Argoverse 2 scenario folder.

    Raises:
        InputError: there is no such demo or folder, or it cannot be read.
    """
    text = str(reference)
    check_path(text)
    name = text.removeprefix(DEMO_PREFIX)
    if name in demo_names() and not os.path.isdir(text):
        scenario = read_scenario(demo_folder(name))
        provenance = dataclasses.replace(
            scenario.provenance, source=f"{DEMO_PREFIX}{name}"
        )
        return dataclasses.replace(scenario, provenance=provenance)
    # os.path, unlike pathlib, takes an unknown ~user or a forbidden parent calmly.
    folder = os.path.expanduser(text)
    if not os.path.isdir(folder):
        raise InputError(
            f"{text}: is neither a scenario folder nor a demo "
            f"({', '.join(demo_names())})."
        )
    return read_scenario(Path(folder))


def exported_files(scenario: Scenario, recipe: Recipe) -> dict[str, bytes]:
    """The scenario as an Argoverse 2 folder's files, with the recipe that made it.

    Raises:
        ExportError: the scenario cannot be written, for example without a focal agent.
    """
    agents, focal_id = scenario.agents, scenario.focal_id
    row = agents.row_of.get(focal_id)
    if len(agents) and (row is None or not agents.is_valid[row].any()):
        raise ExportError(
            f"Scenario {scenario.scenario_id} has no focal agent ({focal_id or 'none'} is"
            " not there); make an agent the focal one first."
        )
    scenario = scenario.with_agents(with_focal_category(agents, focal_id))
    return {**scenario_files(scenario), RECIPE_NAME: recipe.to_text().encode()}


def check_free(
    out: str | Path, name: str, scenario: Scenario, *, overwrite: bool = False
) -> None:
    """Refuse ``out/name`` as ``export_into`` would, before the work is done.

    Raises:
        ExportError: the folder holds something, or is the one that was read.
    """
    files = tracks_name(scenario.scenario_id), map_name(scenario.scenario_id)
    check_place(
        Path(out) / name,
        (*files, RECIPE_NAME),
        forbidden=_input_folder(scenario),
        overwrite=overwrite,
    )


def export_into(
    out: str | Path,
    name: str,
    scenario: Scenario,
    recipe: Recipe,
    *,
    overwrite: bool = False,
) -> Path:
    """Write ``out/name`` with the exported files; the input is never overwritten.

    Raises:
        ExportError: the folder cannot be written, or holds something else.
    """
    folder = Path(out) / name
    write_files(
        exported_files(scenario, recipe),
        folder,
        forbidden=_input_folder(scenario),
        overwrite=overwrite,
    )
    return folder


def _input_folder(scenario: Scenario) -> Path | None:
    """The folder that a scenario was read from; None if it was uploaded."""
    source = scenario.provenance.source
    if not source:
        return None
    if source.startswith(DEMO_PREFIX):
        return demo_folder(source.removeprefix(DEMO_PREFIX))
    return Path(source)
