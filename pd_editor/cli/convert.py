"""``pd-editor convert``: write scenes of any format in another one."""

from pathlib import Path

from pd_editor.cli.many_scenes import SCENE_FILES, over_scenes
from pd_editor.cli.options.arguments import (
    AddressOption,
    AroundOption,
    CurrentOption,
    DensestOption,
    FolderOption,
    FormatOption,
    NameOption,
    OptionalWorkers,
    RadiusOption,
    Switch,
    UntilOption,
)
from pd_editor.cli.output.outcome import Outcome, described, write_session
from pd_editor.editor.scenario_store import LOSSES_NAME, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.experiments.work_engine import EngineName
from pd_editor.scene.formats.registry import writer


@over_scenes(SCENE_FILES)
def convert(
    scenario: str | Path,
    /,
    *,
    to: FormatOption,
    out: FolderOption,
    current: CurrentOption = None,
    until: UntilOption = None,
    around: AroundOption = None,
    radius: RadiusOption = None,
    densest: DensestOption = None,  # noqa: ARG001
    name: NameOption = "",
    overwrite: Switch = False,
    engine: EngineName = "local",  # noqa: ARG001
    address: AddressOption = None,  # noqa: ARG001
    workers: OptionalWorkers = None,  # noqa: ARG001
) -> Outcome:
    """Write scenes of any format that is read in another one.

    Args:
        scenario: Demos, Argoverse 2 scenario folders, files of other formats, folders of these, or patterns; demos for all demos. What is written already stays as it is.
        to: Name of the format to write.
        out: Folder that receives DIR/<name>/.
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
        around: Metres in the file's frame, about which a square of its map is used; for maps beyond the limits of a scene.
        radius: Half the side of that square.
        densest: Use the N squares with the greatest length of lanes, each as a scene of its own.
        name: Id of the written scenario, for one scenario only.
        overwrite: Replace what an earlier run wrote.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """
    writer(to)  # A format that cannot be written is refused before files are read.
    session = EditorSession(
        open_scenario(
            scenario, current_s=current, until_s=until, around=around, radius_m=radius
        )
    )
    session.describe(described(name))
    folder = write_session(out, session, overwrite=overwrite, format_name=to)
    losses = (folder / LOSSES_NAME).exists()
    told = session.base.provenance.notes
    return Outcome(
        folders=(folder,),
        scenarios=(session.scenario,),
        remarks=(
            *told,
            *(f"{folder / LOSSES_NAME} tells what {to} cannot say.",) * losses,
        ),
    )
