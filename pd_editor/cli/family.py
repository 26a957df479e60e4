"""``pd-editor family``: many variants of one edited scenario."""

import csv
import io
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import ExportError, PdEditorError
from pd_editor.base.regular_file import write_whole
from pd_editor.cli.options.arguments import FolderOption, Switch
from pd_editor.cli.output.outcome import Outcome
from pd_editor.cli.output.progress import ProgressLine
from pd_editor.cli.replay import open_base, read_recipe
from pd_editor.editor.family import (
    Member,
    adds_traffic,
    member,
    members,
    values_of,
)
from pd_editor.editor.library.index_table import index_row
from pd_editor.editor.recipe import replay
from pd_editor.editor.scenario_store import check_free, export_into
from pd_editor.editor.varied_numbers import (
    values_in_words,
    varied_numbers,
    varied_values,
)
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.formats.player import player_page
from pd_editor.scene.generation import ScenarioGenerator


def family(
    recipe: Annotated[
        str | Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECIPE")
    ],
    /,
    *,
    vary: Annotated[
        str | tuple[str, ...], tyro.conf.arg(metavar="NAME=LOW..HIGH [...]")
    ],
    out: FolderOption,
    num: Annotated[int, tyro.conf.arg(metavar="N")] = 10,
    seed: Annotated[int, tyro.conf.arg(metavar="N")] = 0,
    base: Annotated[
        str | Path | None,
        tyro.conf.arg(metavar="SCENARIO", help_behavior_hint="(optional)"),
    ] = None,
    model: Annotated[
        str, tyro.conf.arg(metavar="NAME", help_behavior_hint="(as in the recipe)")
    ] = "",
    overwrite: Switch = False,
) -> Outcome:
    """Apply a recipe many times with other numbers, and generate its traffic anew.

    A recipe without generated traffic, or with guidance that was not run, gets traffic
    of everybody at its end. DIR/<name>-family.csv has the numbers and problems of each,
    DIR/<name>-family.html plays them.

    Args:
        recipe: A file recipe.json, or an exported folder.
        vary: Numbers of the recipe's commands and their ranges, such as power=4..8, gap_m=5..15 or seed=1..999. Where several have a name, 2.power is that of the second edit, point_m.0 the first of a list.
        out: Folder that receives DIR/<name>-1/, ...
        num: Number of variants; their values cover each range evenly.
        seed: Random seed of the values.
        base: Where the base scenario is, if not where the recipe says.
        model: What regenerates, if the recipe's name of it is not enough: the folder of a model, or package.module:attribute.
        overwrite: Replace what an earlier run wrote.
    """
    parsed, where = read_recipe(Path(recipe))
    opened = open_base(parsed, where, base)
    adds = adds_traffic(parsed, replay(parsed, opened))
    texts = (vary,) if isinstance(vary, str) else vary
    numbers = varied_numbers(parsed, texts, adds=adds)
    values = list(members(numbers, num, seed))

    def make(said: str) -> ScenarioGenerator:
        return make_generator(model or said or DEFAULT_GENERATOR)

    names = [f"{parsed.result_id}-{n:0{len(str(num))}d}" for n in range(1, num + 1)]
    whole = Path(out) / f"{parsed.result_id}-family"
    table = whole.with_name(f"{whole.name}.csv")
    page = whole.with_name(f"{whole.name}.html")
    if os.path.exists(table) and not overwrite:
        raise ExportError(f"{table}: is there already; add --overwrite to replace it.")
    for name in names:
        check_free(out, name, opened, overwrite=overwrite)
    made: list[tuple[Path, Member]] = []
    failures, line = [], ProgressLine()
    interrupt = None
    try:
        for number, (name, own) in enumerate(zip(names, values, strict=True), start=1):
            try:
                one = member(parsed, opened, own, name, make, adds=adds)
                folder = export_into(
                    out, one.scenario, one.recipe, base=one.base, overwrite=overwrite
                )
                made.append((folder, one))
            except PdEditorError as error:
                failures.append(
                    f"{name} ({values_in_words(values_of(own))}) failed: {error}"
                )
            line.show(f"{number} of {num} variants")
    except KeyboardInterrupt as error:
        # What is made by then is told all the same.
        interrupt = error
    line.clear()
    if not made:
        raise interrupt or ExportError(failures[0])
    rows = [
        [
            one.recipe.result_id,
            *varied_values(one.recipe).values(),
            index_row(one.scenario, one.base, one.recipe).num_problems,
        ]
        for _, one in made
    ]
    head = ["name", *(one.name for one in numbers), "num_problems"]
    write_whole(table, _csv([head, *rows]))
    scenes = tuple(
        replace(one.scenario, scenario_id=one.recipe.result_id) for _, one in made
    )
    write_whole(page, player_page(scenes))
    if interrupt is not None:
        raise interrupt
    return Outcome(
        folders=(*(folder for folder, _ in made), table, page),
        scenarios=scenes,
        remarks=(
            f"{len(made)} of {num} variants, {sum(not row[-1] for row in rows)} without problems.",
            *failures,
        ),
    )


def _csv(rows: Iterable[Sequence[object]]) -> bytes:
    sink = io.StringIO(newline="")
    csv.writer(sink).writerows(rows)
    return sink.getvalue().encode()
