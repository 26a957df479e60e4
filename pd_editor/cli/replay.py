"""``pd-editor replay``: reproduce a scenario from its recipe."""

import os
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import InputError, RecipeError
from pd_editor.base.regular_file import check_path, read_regular
from pd_editor.cli.many_scenes import over_scenes
from pd_editor.cli.options.arguments import (
    AddressOption,
    FolderOption,
    OptionalWorkers,
    Switch,
)
from pd_editor.cli.output.outcome import Outcome
from pd_editor.editor.recipe import (
    MAX_RECIPE_BYTES,
    Recipe,
    RegeneratedEntry,
    regenerated,
)
from pd_editor.editor.recipe import replay as replay_recipe
from pd_editor.editor.scenario_store import RECIPE_NAME, export_into
from pd_editor.editor.scenario_store import open_base as open_base_of
from pd_editor.experiments.work_engine import EngineName
from pd_editor.generation.generators import make_generator
from pd_editor.scene.scenario import Scenario


@over_scenes(RECIPE_NAME)
def replay(
    recipe: str | Path,
    /,
    *,
    out: FolderOption,
    base: Annotated[
        str | Path | None,
        tyro.conf.arg(metavar="SCENARIO", help_behavior_hint="(optional)"),
    ] = None,
    regenerate: Switch = False,
    model: Annotated[
        str, tyro.conf.arg(metavar="NAME", help_behavior_hint="(as in the recipe)")
    ] = "",
    overwrite: Switch = False,
    engine: EngineName = "local",  # noqa: ARG001
    address: AddressOption = None,  # noqa: ARG001
    workers: OptionalWorkers = None,  # noqa: ARG001
) -> Outcome:
    """Apply a recipe's commands to its base scenario and write the result.

    Args:
        recipe: Files recipe.json, exported folders, folders of such folders, or patterns. What is written already stays as it is.
        out: Folder that receives DIR/<name>/.
        base: Where the base scenario is, if not where the recipe says.
        regenerate: Generate generated traffic again, and say whether it is equal.
        model: What regenerates, if the recipe's name of it is not enough: the folder of a model, or package.module:attribute.
        overwrite: Replace what an earlier run wrote.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """
    parsed, where = read_recipe(Path(recipe))
    opened = open_base(parsed, where, base)
    remarks: tuple[str, ...] = ()
    if regenerate:
        scenario, parsed, entries = regenerated(
            parsed, opened, lambda name: make_generator(model or name)
        )
        remarks = tuple(map(_verdict, entries))
    else:
        scenario = replay_recipe(parsed, opened)
    folder = export_into(
        out,
        scenario,
        parsed,
        base=opened.as_referred_to(parsed.base),
        overwrite=overwrite,
    )
    return Outcome(folders=(folder,), scenarios=(scenario,), remarks=remarks)


def read_recipe(path: Path) -> tuple[Recipe, Path]:
    """Read a recipe; returns it and its file."""
    check_path(path, RecipeError)
    file = path / RECIPE_NAME if os.path.isdir(path) else path
    text = read_regular(file, max_bytes=MAX_RECIPE_BYTES, error=RecipeError)
    try:
        return Recipe.from_text(text), file
    except RecipeError as error:
        raise RecipeError(f"{file}: {error}") from error


def open_base(recipe: Recipe, where: Path, base: str | Path | None) -> Scenario:
    """Open the base scenario of a recipe, or ``base`` in its place.

    Raises:
        InputError: it cannot be opened.
        RecipeError: the recipe does not say where it is.
    """
    if base is not None:
        return open_base_of(recipe.base, base)
    if not recipe.base.source:
        raise RecipeError(
            f"{where}: its scenario {recipe.base.scenario_id} was uploaded; "
            "name its folder with --base."
        )
    try:
        return open_base_of(recipe.base)
    except InputError as error:
        raise RecipeError(
            f"{where}: its scenario cannot be opened; if it was moved, name its "
            f"folder with --base ({error})"
        ) from error


def _verdict(entry: RegeneratedEntry) -> str:
    if entry.is_equal:
        return f"Entry {entry.number}: generated again, equal."
    return (
        f"Entry {entry.number}: generated again, NOT equal, positions up to "
        f"{entry.max_difference_m:.3f} m apart."
    )
