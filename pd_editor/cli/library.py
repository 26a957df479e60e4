"""Keep scenarios in a folder, find, describe, check and hand them on."""

import json as json_text
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.analysis.findings.scorecard import ROWS
from pd_editor.base.errors import ExportError, InputError
from pd_editor.base.plain_text import aligned, nearest_or_all, number_of, one_line
from pd_editor.base.regular_file import state_folder, user_path, write_whole
from pd_editor.cli.export import ZIP_NAME, opened_session
from pd_editor.cli.find import Found, found_in
from pd_editor.cli.many_scenes import all_scenes, engine_of
from pd_editor.cli.options import (
    FolderOption,
    FormatOption,
    NoteOption,
    OptionalWorkers,
    SeveralScenarios,
    Switch,
    TagsOption,
    several,
    shown,
)
from pd_editor.cli.output import Outcome, described, refuse_existing, work_shown
from pd_editor.editor.library.index_table import INDEX_NAME
from pd_editor.editor.library.library import SORTS, Library, LibraryCard, take_in
from pd_editor.editor.recipe import moment
from pd_editor.editor.variant import Variant, tags_from_text
from pd_editor.experiments.scene_index.index_file import IndexWriter, index_place
from pd_editor.experiments.scene_index.query import find_scenes
from pd_editor.experiments.work_engine.ray_cluster import EngineChoice
from pd_editor.experiments.work_engine.work_engine import (
    WorkFailure,
    failure_of,
    run_items,
)
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.bundle import write_files
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.formats.registry import writer

_Folder = Annotated[str | Path, tyro.conf.Positional, shown("FOLDER")]
_Names = Annotated[
    str | tuple[str, ...],
    tyro.conf.Positional,
    shown("NAME [...]", "(required)"),
]
_Author = Annotated[str, shown("NAME", "")]
_Note = Annotated[str | None, shown("TEXT", "(optional)")]
_Sort = Annotated[str, shown("ORDER")]


@dataclass(frozen=True, kw_only=True)
class Listed:
    """Cards of scenarios."""

    cards: tuple[LibraryCard, ...]
    metric: str = ""
    """Metric that the table has, too."""
    is_json: bool = False

    def __str__(self) -> str:
        """A table, or JSON."""
        if self.is_json:
            return json_text.dumps([asdict(one) for one in self.cards], indent=1)
        head = "name", "base", "city", "edits", "problems", "date"
        head += "family", "values", "tags", "note"
        rows = [head, *map(_cells, self.cards)]
        if self.metric:
            values = [one.metrics.get(self.metric) for one in self.cards]
            told = ["" if one is None else f"{one:.4g}" for one in values]
            rows = [
                (first, more, *row)
                for (first, *row), more in zip(rows, [self.metric, *told], strict=True)
            ]
        count = number_of(len(self.cards), "scenario")
        return "\n".join([*aligned(rows), f"{count}."])


def add(
    folder: _Folder,
    scenarios: SeveralScenarios,
    /,
    *,
    tags: TagsOption = (),
    note: NoteOption = "",
    author: _Author = "",
    workers: OptionalWorkers = None,
) -> Outcome:
    """Take scenes, exported folders and recipes into a library.

    What is there already stays as it is. An export keeps its recipe; a name that is taken
    gets a number.

    Args:
        folder: Library; made if it is not there.
        scenarios: Scenes of any format that is read, exported folders, recipe.json files, folders of these, or patterns; demos for all demos.
        tags: Words to find them by, besides their own.
        note: A sentence about them, for those that have none.
        author: Who made them.
        workers: Scenes at a time, each in a process of its own.
    """
    library = Library(user_path(str(folder)))
    # What does not fit is told before scenes are read.
    tags = described("", tags, note).tags
    scenes = all_scenes(scenarios, library.root)
    if not scenes:
        raise InputError("Missing SCENARIO; see pd-editor library add --help.")
    one_more = partial(_added, library.root, tags, note, author)
    names, failures = _of_each(one_more, scenes, workers)
    there = sum(not one for one in names.values())
    return Outcome(
        folders=tuple(library.root / names[one] for one in scenes if names.get(one)),
        scenarios=(),
        remarks=(f"{there} of {len(scenes)} are there already.",) * bool(there),
        failures=failures,
    )


def find(
    folder: _Folder,
    query: Annotated[str, tyro.conf.Positional, shown("QUERY")],
    /,
    *,
    workers: OptionalWorkers = None,
    json: Switch = False,
) -> Found:
    """Find scenarios of a library by what happens in them, as pd-editor find does.

    New and changed ones are read first.

    Args:
        folder: Library.
        query: Such as 'cut-in by bus and density > 20', as pd-editor find has it; or of cards: name, base, parent, author, problems, and the values of families as list shows them, such as 'parent = bend and power > 5'.
        workers: Scenes that are read at a time, each in a process of its own.
        json: Print JSON, with all facts.
    """
    library = _opened(folder)
    writer = IndexWriter(
        index_place(library.root, state_folder()), map(str, library.scenes())
    )
    facts = library.facts()
    # A wrong query is told before scenes are read.
    find_scenes(writer.index().beside(facts), query)
    with engine_of(EngineChoice(num_workers=workers)) as engine:
        failures = writer.read_missing(engine, work_shown("scenarios"))
    index = writer.index().beside(facts)
    return found_in(index, query, is_json=json, noun="scenario", failures=failures)


def tag(
    folder: _Folder,
    names: _Names,
    /,
    *,
    add: TagsOption = (),
    remove: TagsOption = (),
    note: _Note = None,
) -> Outcome:
    """Tag scenarios of a library, and write notes on them.

    Nothing is changed unless all can be; each is replaced in one step.

    Args:
        folder: Library.
        names: Names, or patterns such as 'cut-in-*'.
        add: Tags that they get.
        remove: Tags that they lose.
        note: Their note; an empty one removes it.
    """
    library = _opened(folder)
    add, remove = tags_from_text(*add), (*remove, *tags_from_text(*remove))
    if not (add or remove or note is not None):
        raise InputError("Nothing to change; expected --add, --remove or --note.")
    chosen = library.named(several(names))
    count = library.describe(chosen, lambda one: one.tagged(add, remove, note))
    told = f"{count} of {len(chosen)} scenarios changed."
    return Outcome(folders=(), scenarios=(), remarks=(told,))


def export(
    folder: _Folder,
    names: _Names,
    /,
    *,
    out: FolderOption,
    to: FormatOption = ARGOVERSE2.name,
    zip: Switch = False,
    overwrite: Switch = False,
) -> Outcome:
    """Write scenarios of a library in some format, with an index.csv.

    Args:
        folder: Library.
        names: Names, or patterns such as 'cut-in-*'.
        out: Folder that receives DIR/<name>/ and DIR/index.csv, or the zip.
        to: Format to write: av2, commonroad, gpudrive, opendrive, scenarionet, sumo, tables, player, mp4, webm, gif, pdf, svg, png, or one of your own.
        zip: Write DIR/scenarios.zip instead.
        overwrite: Replace what an earlier run wrote.
    """
    library = _opened(folder)
    writer(to)  # A format that cannot be written is refused before files are read.
    chosen = library.named(several(names))
    place = Path(out)
    table = place / (ZIP_NAME if zip else INDEX_NAME)
    refuse_existing(table, overwrite=overwrite)
    if zip:
        write_whole(table, library.zipped(chosen, to))
        return Outcome(folders=(table,), scenarios=())
    failures, written = {}, []
    for name in chosen:
        try:
            files = library.files(name, to)
            write_files(
                files, place / name, forbidden=library.root, overwrite=overwrite
            )
            written.append(name)
        except (InputError, ExportError) as error:
            failures[name] = failure_of(error)
    if written:
        write_whole(table, library.table(written))
    folders = tuple(place / one for one in written)
    return Outcome(folders=folders, scenarios=(), failures=failures)


def metrics(
    folder: _Folder, names: _Names, /, *, workers: OptionalWorkers = None
) -> Outcome:
    """Compute the metrics of scenarios of a library, and keep them in their cards.

    They are those of the scorecard, of the scenario's own trajectories. Lists sort by
    them, queries ask for them: off_drivable > 0.1.

    Args:
        folder: Library.
        names: Names, or patterns such as 'cut-in-*'.
        workers: Scenes at a time, each in a process of its own.
    """
    library = _opened(folder)
    chosen = library.named(several(names))
    done, failures = _of_each(partial(_measured, library.root), chosen, workers)
    told = f"{len(done)} of {len(chosen)} scenarios measured."
    return Outcome(folders=(), scenarios=(), remarks=(told,), failures=failures)


def check(folder: _Folder, /, *, workers: OptionalWorkers = None) -> Outcome:
    """Check that every scenario of a library is whole.

    Each must open, agree with its card, and be what its recipe makes, where the recipe's
    base is at hand. Exits with 2 if something is wrong.

    Args:
        folder: Library.
        workers: Scenes at a time, each in a process of its own.
    """
    library = _opened(folder)
    names = library.folders()
    whole, failures = _of_each(partial(_checked, library.root), names, workers)
    told = f"{len(whole)} of {len(names)} scenarios are whole."
    return Outcome(folders=(), scenarios=(), remarks=(told,), failures=failures)


def list(
    folder: _Folder,
    words: Annotated[
        tuple[str, ...],
        tyro.conf.Positional,
        shown("[WORD ...]", ""),
    ] = (),
    /,
    *,
    tag: TagsOption = (),
    sort: _Sort = "date",
    json: Switch = False,
) -> Listed:
    """List the scenarios of a library.

    Args:
        folder: Library.
        words: Only those whose name, base, family, values, city, edits, problems, tags, note or author have these words.
        tag: Only those with these tags.
        sort: date, name, base, city, problems, agents, or a metric that pd-editor library metrics has computed. Dates and numbers begin with the greatest.
        json: Print JSON, with all that the cards tell.
    """
    if sort not in SORTS:
        raise InputError(f"{sort!r} is no order; {nearest_or_all(sort, SORTS)}.")
    tags = set(tags_from_text(*tag))
    cards = [
        one
        for one in _opened(folder).cards()
        if one.has(words) and tags <= set(one.row.tags)
    ]
    return Listed(
        cards=tuple(sorted(cards, key=SORTS[sort])),
        metric=sort if sort in ROWS else "",
        is_json=json,
    )


def _opened(folder: str | Path) -> Library:
    library = Library(user_path(str(folder)))
    library.folders()
    if library.is_other():
        raise InputError(
            f"{library.root}: is no library: it holds no scenario with a card;"
            " 'pd-editor library add' takes in scenes of other folders."
        )
    return library


def _of_each(
    function: Callable[[str], str], items: Iterable[str], workers: int | None
) -> tuple[dict[str, str], Mapping[str, WorkFailure]]:
    """What a function says of each item, and why it could not."""
    told: dict[str, str] = {}
    with engine_of(EngineChoice(num_workers=workers)) as engine:
        failures = run_items(
            engine,
            function,
            {one: one for one in items},
            on_value=told.__setitem__,
            on_progress=work_shown("scenarios"),
        )
    return told, failures


def _checked(root: Path, name: str) -> str:
    Library(root).check(name)
    return name


def _measured(root: Path, name: str) -> str:
    Library(root).measure(name)
    return name


def _added(
    root: Path, tags: tuple[str, ...], note: str, author: str, reference: str
) -> str:
    """Take one scene into a library; returns its name, or none if it is there already."""
    library = Library(root)
    session = opened_session(reference, Variant(), SceneCut())
    return take_in(library, session, reference, tags=tags, note=note, author=author)


def _cells(card: LibraryCard) -> tuple[str, ...]:
    row = card.row
    told = (
        card.name,
        row.base_id,
        row.city,
        str(len(row.edits)),
        str(row.num_problems),
        f"{moment(card.saved_at):%Y-%m-%d %H:%M}",
        row.parent if row.values else "",
        row.values_told,
        ", ".join(row.tags),
        row.note,
    )
    return tuple(one_line(one, 60) for one in told)
