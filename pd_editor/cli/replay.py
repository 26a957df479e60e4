"""``pd-editor replay``: reproduce a scenario from its recipe."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

import tyro

from pd_editor.base.errors import GenerationError, InputError, RecipeError
from pd_editor.base.regular_file import check_path, read_regular
from pd_editor.cli.many_scenes import ManyOptions, Scenes, over_scenes
from pd_editor.cli.options import Switch, shown
from pd_editor.cli.output import Outcome
from pd_editor.editor.recipe import (
    MAX_RECIPE_BYTES,
    Recipe,
    RegeneratedEntry,
    regenerated,
)
from pd_editor.editor.recipe import replay as replay_recipe
from pd_editor.editor.scenario_store import RECIPE_NAME, export_into
from pd_editor.editor.scenario_store import open_base as open_base_of
from pd_editor.generation.generators import make_generator
from pd_editor.scene.generation import ScenarioGenerator
from pd_editor.scene.scenario import Scenario

_NAME_IT: Final = "make it again from its folder with 'pd-editor replay --base DIR'"


@dataclass(frozen=True, kw_only=True)
class RecipeOptions:
    """What a recipe needs that it may not have.

    Args:
        base: Where the base scenario is, if not where the recipe says.
        model: What regenerates, if the recipe's name of it is not enough: the folder of a model, or package.module:attribute.
    """

    base: Annotated[str | Path | None, shown("SCENARIO", "(optional)")] = None
    model: Annotated[str, shown("NAME", "(as in the recipe)")] = ""


@dataclass(frozen=True, kw_only=True)
class ReplayOptions(RecipeOptions, ManyOptions):
    """Options of ``pd-editor replay``.

    Args:
        scenario: Files recipe.json, exported folders, folders of such folders, or patterns. What is written already stays as it is.
        regenerate: Generate generated traffic again, and say whether it is equal.
    """

    scenario: Annotated[
        Scenes, tyro.conf.Positional, shown("RECIPE [...]", "(required)")
    ] = field(kw_only=False)
    regenerate: Switch = False


@over_scenes(ReplayOptions, RECIPE_NAME, "RECIPE")
def replay(recipe: str, options: ReplayOptions) -> Outcome:
    """Apply a recipe's commands to its base scenario and write the result."""
    parsed, where = read_recipe(Path(recipe))
    opened = open_base(parsed, where, options.base)
    remarks: tuple[str, ...] = ()
    if options.regenerate:
        scenario, parsed, entries = regenerated(
            parsed, opened, lambda name: generator_of(name, options.model)
        )
        remarks = tuple(map(_verdict, entries))
    else:
        scenario = replay_recipe(parsed, opened)
    folder = export_into(
        options.out,
        scenario,
        parsed,
        base=opened.as_referred_to(parsed.base),
        overwrite=options.overwrite,
    )
    return Outcome(folders=(folder,), scenarios=(scenario,), remarks=remarks)


def read_recipe(path: Path) -> tuple[Recipe, Path]:
    """Read a recipe; returns it and its file."""
    check_path(path, RecipeError)
    file = path / RECIPE_NAME if os.path.isdir(path) else path
    if not os.path.exists(file):
        raise RecipeError(
            f"{file}: is not there; expected a file recipe.json, or an exported folder."
        )
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
            f"{where}: its scenario {recipe.base.scenario_id} was uploaded; {_NAME_IT}."
        )
    try:
        return open_base_of(recipe.base)
    except InputError as error:
        raise RecipeError(
            f"{where}: its scenario cannot be opened; if it was moved, {_NAME_IT} ({error})"
        ) from error


def generator_of(said: str, given: str) -> ScenarioGenerator:
    """The generator that is given, else that of a recipe.

    Raises:
        GenerationError: it cannot be made.
    """
    if given:
        return make_generator(given)
    try:
        return make_generator(said)
    except GenerationError as error:
        raise GenerationError(
            f"{error} If the recipe's model was moved, or is your own, name it by --model."
        ) from error


def _verdict(entry: RegeneratedEntry) -> str:
    if entry.is_equal:
        return f"Entry {entry.number}: generated again, equal."
    return (
        f"Entry {entry.number}: generated again, NOT equal, positions up to "
        f"{entry.max_difference_m:.3f} m apart."
    )
