"""``pd-editor export``: write scenarios, with a name, tags and a note."""

from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import tyro

from pd_editor.base.errors import EditError, ExportError
from pd_editor.base.plain_text import listed
from pd_editor.base.regular_file import write_whole
from pd_editor.cli.options import (
    CutOptions,
    FocalOption,
    FormatOption,
    NameOption,
    NoteOption,
    ResultOptions,
    SeveralScenarios,
    Switch,
    TagsOption,
    taking,
)
from pd_editor.cli.output import (
    Outcome,
    described,
    refuse_existing,
    undated_recipe,
    write_session,
)
from pd_editor.cli.replay import open_base, read_recipe
from pd_editor.editor.commands import SetFocalAgent
from pd_editor.editor.library.index_table import INDEX_NAME, index_csv, index_row
from pd_editor.editor.scenario_store import exported_files, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant, free_name
from pd_editor.scene.av2_io.write import check_with_official_loaders
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.bundle import zip_folders
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.formats.registry import format_of, writer

ZIP_NAME: Final = "scenarios.zip"


@dataclass(frozen=True, kw_only=True)
class ExportOptions(CutOptions, ResultOptions):
    """Options of ``pd-editor export``.

    Args:
        scenarios: Demos' names, Argoverse 2 scenario folders, files of other formats, or recipe.json files.
        out: Folder that receives DIR/<name>/, or the zip.
        to: Format to write: av2, commonroad, gpudrive, opendrive, scenarionet, sumo, tables, player, mp4, webm, gif, pdf, svg, png, or one of your own.
        focal: Id of the agent that becomes the focal one.
        name: Id of the written scenario, for one scenario only.
        tags: Words to find it by, kept in its recipe.
        note: A sentence about it, kept in its recipe.
        zip: Write DIR/scenarios.zip with a folder for each scenario and an index.csv.
        verify: Load the result with av2's own loaders and with the editor's reader, too.
    """

    scenarios: SeveralScenarios = field(kw_only=False)
    to: Annotated[FormatOption, tyro.conf.arg(aliases=("--format",))] = ARGOVERSE2.name
    focal: FocalOption = ""
    name: NameOption = ""
    tags: TagsOption = ()
    note: NoteOption = ""
    zip: Switch = False
    verify: Switch = False


@taking(ExportOptions)
def export(options: ExportOptions) -> Outcome:
    """Write scenarios as new folders, or all in one zip, each with a recipe.json."""
    name, scenarios = options.name, options.scenarios
    writer(options.to)  # What cannot be written is refused before files are read.
    references = scenarios if isinstance(scenarios, tuple) else (scenarios,)
    if not references:
        raise EditError("Missing SCENARIO; see pd-editor export --help.")
    if name and len(references) > 1:
        raise EditError(
            f"--name is for one scenario; {len(references)} were given, which are named "
            "by their edits."
        )
    if options.zip and options.verify:
        raise ExportError("--verify looks at folders; give --zip or --verify.")
    if options.verify and options.to != ARGOVERSE2.name:
        raise ExportError(f"--verify is for {ARGOVERSE2.name}; leave it out.")
    if options.verify and find_spec("av2") is None:
        raise ExportError(
            "--verify asks the loaders of the package av2, which is missing; it comes "
            "with Python 3.11 and 3.12."
        )
    about = described(name, options.tags, options.note)
    sessions = [opened_session(str(one), about, options.cut) for one in references]
    for session in sessions if options.focal else ():
        session.apply(SetFocalAgent(agent_id=options.focal))
    folders = _zipped(options, sessions) if options.zip else _written(options, sessions)
    return Outcome(
        folders=folders,
        scenarios=tuple(session.scenario for session in sessions),
        remarks=tuple(map(_verified, folders)) if options.verify else (),
    )


def _written(options: ExportOptions, sessions: list[EditorSession]) -> tuple[Path, ...]:
    return tuple(
        write_session(
            options.out, one, overwrite=options.overwrite, format_name=options.to
        )
        for one in sessions
    )


def _verified(folder: Path) -> str:
    """Load a written folder with all loaders, and say what they see.

    Raises:
        ExportError: a loader refuses it, or misses an agent.
        InputError: the editor's own reader refuses it.
    """
    visible, scenario = check_with_official_loaders(folder), open_scenario(folder)
    read_recipe(folder)
    agents, now = scenario.agents, scenario.current_step
    present = [agents.ids[row] for row in np.flatnonzero(agents.is_valid[:, now])]
    hidden = [name for name in present if name not in visible]
    if hidden:
        raise ExportError(
            f"{folder}: loaders do not see agent {listed(hidden, 1)}"
            " at the last observed step; sample them again, with a past."
        )
    return (
        "Loaded again with av2's own loaders and the editor's reader; "
        f"{len(present)} of {len(present)} agents are visible to loaders at the last "
        "observed step."
    )


def opened_session(reference: str, variant: Variant, cut: SceneCut) -> EditorSession:
    """Open a session on a scenario, or on the result of a recipe."""
    if not reference.endswith(".json") or format_of(Path(reference)) is not None:
        session = EditorSession(
            open_scenario(reference, current_s=cut.current_s, until_s=cut.until_s)
        )
        session.describe(variant)
        return session
    recipe, where = read_recipe(Path(reference))
    session = EditorSession.from_recipe(recipe, open_base(recipe, where, None))
    own = session.variant
    session.describe(
        replace(
            own,
            name=variant.name or own.name,
            tags=variant.tags or own.tags,
            note=variant.note or own.note,
        )
    )
    return session


def _zipped(options: ExportOptions, sessions: list[EditorSession]) -> tuple[Path, ...]:
    """Write one zip; the second of two scenarios of the same name gets -2."""
    target = Path(options.out) / ZIP_NAME
    refuse_existing(target, overwrite=options.overwrite)
    made: dict[str, dict[str, bytes]] = {}
    rows = []
    for session in sessions:
        recipe = undated_recipe(session)
        name = free_name(recipe.result_id, made.__contains__)
        if name != recipe.result_id:
            session.describe(replace(session.variant, name=name))
            recipe = undated_recipe(session)
        made[name] = exported_files(session.scenario, recipe, session.base, options.to)
        rows.append(index_row(session.scenario, session.base, recipe))
    content = zip_folders(made, {INDEX_NAME: index_csv(rows)})
    write_whole(target, content)
    return (target,)
