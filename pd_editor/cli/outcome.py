"""What the commands hand back, and how they write it."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from pd_editor.editor.session import EditorSession
from pd_editor.scenario_store import export_into
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Scenarios that a command made and wrote."""

    folders: tuple[Path, ...]
    """One folder per scenario: tracks, map and recipe.json."""
    scenarios: tuple[Scenario, ...]
    remarks: tuple[str, ...] = ()
    """One sentence each: figures, and what the user should know."""

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
    out: str | Path, name: str, session: EditorSession, *, overwrite: bool
) -> Path:
    """Write ``out/name``: a session's scenario, and the recipe that leads to it.

    The recipe carries no date, so equal work gives equal files.

    Raises:
        ExportError: the folder cannot be written, or holds something else.
    """
    recipe = dataclasses.replace(session.recipe(), created_at="")
    return export_into(out, name, session.scenario, recipe, overwrite=overwrite)
