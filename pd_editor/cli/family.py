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
from pd_editor.editor.family import Member, in_words, member, members, varied_numbers
from pd_editor.editor.library.index_table import index_row
from pd_editor.editor.scenario_store import export_into
from pd_editor.generation.generators import make_generator
from pd_editor.scene.formats.player import player_page


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

    DIR/<name>-family.csv has the numbers and problems of each, DIR/<name>-family.html
    plays them.

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
    numbers = varied_numbers(parsed, (vary,) if isinstance(vary, str) else vary)
    values = list(members(numbers, num, seed))
    opened = open_base(parsed, where, base)
    whole = Path(out) / f"{parsed.result_id}-family"
    table = whole.with_name(f"{whole.name}.csv")
    if os.path.exists(table) and not overwrite:
        raise ExportError(f"{table}: is there already; add --overwrite to replace it.")
    made: list[tuple[Path, Member]] = []
    failures, line = [], ProgressLine()
    for number, own in enumerate(values, start=1):
        name = f"{parsed.result_id}-{number:0{len(str(num))}d}"
        try:
            one = member(
                parsed, opened, own, name, lambda said: make_generator(model or said)
            )
            folder = export_into(
                out, one.scenario, one.recipe, base=one.base, overwrite=overwrite
            )
            made.append((folder, one))
        except PdEditorError as error:
            failures.append(f"{name} ({in_words(own)}) failed: {error}")
        line.show(f"{number} of {num} variants")
    line.clear()
    if not made:
        raise ExportError(failures[0])
    head = ["name", *(one.name for one in numbers), "num_problems"]
    rows = []
    for _, one in made:
        problems = index_row(one.scenario, one.base, one.recipe).num_problems
        rows.append([one.recipe.result_id, *one.values.values(), problems])
    write_whole(table, _csv([head, *rows]))
    page = whole.with_name(f"{whole.name}.html")
    scenes = tuple(
        replace(one.scenario, scenario_id=one.recipe.result_id) for _, one in made
    )
    write_whole(page, player_page(scenes))
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
