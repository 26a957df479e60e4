"""``pd-editor export``: write a scenario in another format."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from pd_editor.av2_io.official import check_with_official_loaders
from pd_editor.editor.session import EditorSession
from pd_editor.scenario_store import export_into, open_scenario

Format = Literal["av2"]


def export(
    scenario: Annotated[str, tyro.conf.Positional],
    /,
    *,
    out: Path,
    format: Format = "av2",
    verify: bool = False,
    overwrite: bool = False,
) -> Path:
    """Write a scenario with its recipe.

    Args:
        scenario: A demo's name or an Argoverse 2 scenario folder.
        out: Folder that receives OUT/<scenario id>/.
        format: av2: parquet and map JSON, all steps.
        verify: Load the result with av2's own loaders, too.
        overwrite: Replace what an earlier run wrote.
    """
    assert format == "av2"
    session = EditorSession(open_scenario(scenario))
    folder = export_into(
        out,
        session.scenario.scenario_id,
        session.scenario,
        session.recipe(),
        overwrite=overwrite,
    )
    if verify:
        check_with_official_loaders(folder)
    sys.stdout.write(f"{folder}\n")
    return folder
