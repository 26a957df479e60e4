"""``pd-editor family``: many variants of one edited scenario."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import ExportError, PdEditorError
from pd_editor.base.plain_text import csv_file
from pd_editor.base.regular_file import write_whole
from pd_editor.cli.many_scenes import Scenes, all_scenes
from pd_editor.cli.options import Number, ResultOptions, shown, taking
from pd_editor.cli.output import Outcome, ProgressLine, refuse_existing
from pd_editor.cli.replay import RecipeOptions, generator_of, open_base, read_recipe
from pd_editor.editor.family import (
    Member,
    MemberPlan,
    adds_traffic,
    family_name,
    left_out_in_words,
    members,
    planned,
)
from pd_editor.editor.library.index_table import index_row
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import check_free, export_into
from pd_editor.editor.varied_numbers import VariedNumber, varied_numbers, varied_values
from pd_editor.experiments.work_engine.work_engine import WorkFailure, failure_of
from pd_editor.generation.generators import DEFAULT_GENERATOR
from pd_editor.scene.formats.player import player_page
from pd_editor.scene.generation import ScenarioGenerator
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class FamilyOptions(RecipeOptions, ResultOptions):
    """Options of ``pd-editor family``.

    Args:
        recipe: A file recipe.json, or an exported folder.
        vary: Numbers of the recipe's commands and their ranges, such as power=4..8, gap_m=5..15 or seed=1..999. Where several have a name, 2.power is that of the second edit, point_m.0 the first of a list; seed alone is that of every run. Needed unless there is --on.
        on: Other scenes to make the edits in, as in generate, each with N variants if numbers are varied. Edits of single agents, other than the ego and the focal agent, are left out and told.
        out: Folder that receives DIR/<name>-1/, ...
        num: Number of variants; their values cover each range evenly.
        seed: Random seed of the values.
    """

    recipe: Annotated[str | Path, tyro.conf.Positional, shown("RECIPE")] = field(
        kw_only=False
    )
    vary: Annotated[str | tuple[str, ...], shown("NAME=LOW..HIGH [...]", "")] = ()
    on: Annotated[Scenes, shown("SCENARIO [...]", "(its own)")] = ()
    num: Number = 10
    seed: Number = 0


@taking(FamilyOptions)
def family(options: FamilyOptions) -> Outcome:
    """Apply a recipe many times with other numbers or in other scenes, traffic anew.

    A recipe without generated traffic, or with guidance that was not run, gets traffic
    of everybody at its end. DIR/<name>-family.csv has the numbers and problems of each,
    DIR/<name>-family.html plays them.
    """
    recipe, where = read_recipe(Path(options.recipe))
    opened = open_base(recipe, where, options.base)
    adds = adds_traffic(recipe, replay(recipe, opened))
    texts = (options.vary,) if isinstance(options.vary, str) else options.vary
    out = Path(os.path.abspath(options.out))
    on = all_scenes(options.on, out)
    numbers = varied_numbers(recipe, texts, adds=adds) if texts or not on else ()
    values = list(members(numbers, options.num if numbers else 1, options.seed))
    name = family_name(recipe, numbers)
    page = Path(options.out) / f"{name}-family.html"
    table = page.with_name(f"{name}-family.csv")
    refuse_existing(table, overwrite=options.overwrite)
    plans = planned(name, values, on)
    for plan in plans:
        check_free(options.out, plan.name, opened, overwrite=options.overwrite)
    made: list[tuple[Path, Member]] = []
    failures: dict[str, WorkFailure] = {}
    line = ProgressLine()
    interrupt = None
    try:
        each = _made(options, recipe, opened, plans, adds)
        for number, (plan, one) in enumerate(each, start=1):
            if isinstance(one, WorkFailure):
                failures[plan.in_words] = one
            else:
                made.append(one)
            line.show(f"{number} of {len(plans)} variants")
    except KeyboardInterrupt as error:
        # What is made by then is told all the same.
        interrupt = error
    line.clear()
    if not made:
        if interrupt is not None:
            raise interrupt
        name, failure = next(iter(failures.items()))
        raise ExportError(f"{name}: {failure.reason}")
    scenes = tuple(
        replace(one.scenario, scenario_id=one.recipe.result_id) for _, one in made
    )
    told, num_whole = _table(numbers, [one for _, one in made])
    write_whole(table, told)
    write_whole(page, player_page(scenes))
    if interrupt is not None:
        raise interrupt
    return Outcome(
        folders=(*(folder for folder, _ in made), table, page),
        scenarios=scenes,
        remarks=(
            f"{len(made)} of {len(plans)} variants, {num_whole} without problems.",
            *left_out_in_words(one.left_out for _, one in made),
        ),
        failures=failures,
    )


def _made(
    options: FamilyOptions,
    recipe: Recipe,
    opened: Scenario,
    plans: Sequence[MemberPlan],
    adds: bool,
) -> Iterator[tuple[MemberPlan, tuple[Path, Member] | WorkFailure]]:
    """Each variant and its folder, or why there is none."""

    def make(said: str) -> ScenarioGenerator:
        return generator_of(said or DEFAULT_GENERATOR, options.model)

    for plan in plans:
        try:
            one = plan.made(recipe, opened, make, adds=adds)
            folder = export_into(
                options.out,
                one.scenario,
                one.recipe,
                base=one.base,
                overwrite=options.overwrite,
            )
            yield plan, (folder, one)
        except PdEditorError as error:
            yield plan, failure_of(error)


def _table(
    numbers: Sequence[VariedNumber], made: Sequence[Member]
) -> tuple[bytes, int]:
    """Numbers and problems of variants as CSV, and how many have no problem."""
    rows = [
        [
            one.recipe.result_id,
            one.base.scenario_id,
            *varied_values(one.recipe).values(),
            index_row(one.scenario, one.base, one.recipe).num_problems,
        ]
        for one in made
    ]
    head = ["name", "base", *(one.name for one in numbers), "num_problems"]
    told = csv_file([head, *rows], line_end="\r\n")
    return told, sum(not row[-1] for row in rows)
