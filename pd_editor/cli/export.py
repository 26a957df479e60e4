"""``pd-editor export``: write a scenario in another format."""

from typing import Literal

from pd_editor.av2_io.official import check_with_official_loaders
from pd_editor.cli.arguments import FolderOption, ScenarioArgument, Switch
from pd_editor.cli.outcome import Outcome, write_session
from pd_editor.editor.session import EditorSession
from pd_editor.scenario_store import open_scenario

Format = Literal["av2"]


def export(
    scenario: ScenarioArgument,
    /,
    *,
    out: FolderOption,
    format: Format = "av2",
    verify: Switch = False,
    overwrite: Switch = False,
) -> Outcome:
    """Write a scenario as a new folder, with a recipe.json.

    Args:
        scenario: A demo's name or an Argoverse 2 scenario folder.
        out: Folder that receives DIR/<scenario id>/.
        format: The form to write: av2 is parquet tracks and a map JSON, all steps.
        verify: Load the result with av2's own loaders, too.
        overwrite: Replace what an earlier run wrote.
    """
    assert format == "av2"
    session = EditorSession(open_scenario(scenario))
    opened = session.scenario
    folder = write_session(out, opened.scenario_id, session, overwrite=overwrite)
    remarks: tuple[str, ...] = ()
    if verify:
        check_with_official_loaders(folder)
        remarks = ("Loaded again with av2's own loaders.",)
    return Outcome(folders=(folder,), scenarios=(opened,), remarks=remarks)
