"""Results of the commands, and writing of scenarios."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pd_editor.base.errors import ExportError
from pd_editor.editor.commands import Command
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import export_into
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant
from pd_editor.experiments.work_engine.work_engine import WorkFailure
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Scenarios that a command wrote."""

    folders: tuple[Path, ...]
    """One folder per scenario: tracks, map and recipe.json."""
    scenarios: tuple[Scenario, ...]
    """Those of the folders; of a command on several scenes none."""
    remarks: tuple[str, ...] = ()
    """Remarks for the user, one sentence each."""
    failures: Mapping[str, WorkFailure] = field(default_factory=dict)
    """Of a command on several scenes, why some have no folder."""
    records: tuple[Any, ...] = ()
    """What a report of all scenes is made of."""

    @property
    def folder(self) -> Path:
        """The first folder."""
        return self.folders[0]

    @property
    def scenario(self) -> Scenario:
        """The first scenario."""
        return self.scenarios[0]

    def __str__(self) -> str:
        """One line per folder, then the remarks."""
        return "\n".join([*map(str, self.folders), *self.remarks])


def write_session(
    out: str | Path,
    session: EditorSession,
    *,
    overwrite: bool,
    format_name: str = ARGOVERSE2.name,
) -> Path:
    """Write a session's scenario under its name in some format, and its recipe.

    The recipe carries no date, so equal work gives equal files.

    Raises:
        ExportError: the folder cannot be written, or holds something else.
    """
    return export_into(
        out,
        session.scenario,
        undated_recipe(session),
        base=session.base,
        overwrite=overwrite,
        format_name=format_name,
    )


def refuse_existing(file: Path, *, overwrite: bool) -> None:
    """Raise for a file that is there already, unless it may be replaced.

    Raises:
        ExportError: it is there, and stays.
    """
    if os.path.exists(file) and not overwrite:
        raise ExportError(f"{file}: is there already; add --overwrite to replace it.")


def edited_session(
    base: Scenario, commands: Sequence[Command], name: str = ""
) -> EditorSession:
    """A session in which a scenario has been edited, and maybe named."""
    session = EditorSession(base)
    session.describe(described(name))
    for command in commands:
        session.apply(command)
    return session


def undated_recipe(session: EditorSession) -> Recipe:
    """Recipe of a session, without the date."""
    return dataclasses.replace(session.recipe(), created_at="")


def described(name: str, tags: tuple[str, ...] = (), note: str = "") -> Variant:
    """Validate name, tags and note from the shell.

    Raises:
        EditError: the name does not fit, or a text is too long.
    """
    return Variant(name=name, tags=tuple(tags), note=note)
