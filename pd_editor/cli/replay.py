"""``pd-editor replay``: make a scenario again from its recipe."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.editor.commands import ReplaceTraffic
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.recipe import regenerate as regenerate_recipe
from pd_editor.editor.recipe import replay as replay_recipe
from pd_editor.errors import RecipeError
from pd_editor.generators import make_generator
from pd_editor.scenario_store import export_into, open_scenario
from pd_editor.scene.scenario import Scenario


def replay(
    recipe: Annotated[Path, tyro.conf.Positional],
    /,
    *,
    out: Path,
    base: str | None = None,
    regenerate: bool = False,
    overwrite: bool = False,
) -> Path:
    """Apply a recipe's commands to its base scenario and write the result.

    Args:
        recipe: A recipe.json, as every export holds one.
        out: Folder that receives OUT/<scenario id>/.
        base: The base scenario, if it is no longer where the recipe says.
        regenerate: Run generators again instead of using the stored traffic, and say
            whether the result is equal.
        overwrite: Replace what an earlier run wrote.
    """
    try:
        text = recipe.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RecipeError(f"{recipe}: cannot be read as a recipe ({error}).") from error
    parsed = Recipe.from_text(text)
    if base is None and not parsed.base.source:
        raise RecipeError(
            f"{recipe}: was made from an upload; name its scenario with --base."
        )
    opened = open_scenario(base or parsed.base.source)
    if regenerate:
        scenario = _regenerated(parsed, opened)
    else:
        scenario = replay_recipe(parsed, opened)
    folder = export_into(
        out, scenario.scenario_id, scenario, parsed, overwrite=overwrite
    )
    sys.stdout.write(f"{folder}\n")
    return folder


def _regenerated(recipe: Recipe, base: Scenario) -> Scenario:
    names = {
        command.generator
        for command in recipe.commands
        if isinstance(command, ReplaceTraffic)
    }
    if len(names) != 1:
        raise RecipeError(
            f"The recipe holds traffic of {len(names)} generators; expected one to run."
        )
    scenario, entries = regenerate_recipe(recipe, base, make_generator(*names))
    for entry in entries:
        verdict = (
            "equal"
            if entry.is_equal
            else f"NOT equal, up to {entry.max_difference_m:.3f} m apart"
        )
        sys.stdout.write(f"Entry {entry.number}: drawn again, {verdict}.\n")
    return scenario
