"""``pd-editor convert``: write scenes of any format in another one."""

from dataclasses import dataclass

from pd_editor.cli.many_scenes import ManyOptions, PartsOptions, over_scenes
from pd_editor.cli.options import FormatOption, NameOption
from pd_editor.cli.output import Outcome, edited_session, write_session
from pd_editor.editor.scenario_store import LOSSES_NAME, open_part
from pd_editor.scene.formats.registry import writer


@dataclass(frozen=True, kw_only=True)
class ConvertOptions(PartsOptions, ManyOptions):
    """Options of ``pd-editor convert``.

    Args:
        to: Format to write: av2, commonroad, gpudrive, opendrive, scenarionet, sumo, tables, player, mp4, webm, gif, pdf, svg, png, or one of your own.
        name: Id of the written scenario, for one scenario only.
    """

    to: FormatOption
    name: NameOption = ""


@over_scenes(ConvertOptions)
def convert(scenario: str, options: ConvertOptions) -> Outcome:
    """Write scenes of any format that is read in another one."""
    to = options.to
    writer(to)  # A format that cannot be written is refused before files are read.
    session = edited_session(open_part(scenario, options.cut), (), options.name)
    folder = write_session(
        options.out, session, overwrite=options.overwrite, format_name=to
    )
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
