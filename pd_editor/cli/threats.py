"""``pd-editor threats``: list what could happen to an agent."""

from typing import Annotated

import tyro

from pd_editor.analysis.guidance.possible_encounters import (
    endangered_id,
    possible_encounters,
)
from pd_editor.base.errors import EditError
from pd_editor.cli.options.arguments import (
    AroundOption,
    CurrentOption,
    RadiusOption,
    ScenarioArgument,
    UntilOption,
)
from pd_editor.cli.options.guide_option import text_of
from pd_editor.editor.scenario_store import open_scenario


def threats(
    scenario: ScenarioArgument,
    /,
    *,
    to: Annotated[str, tyro.conf.arg(metavar="ID")] = "",
    current: CurrentOption = None,
    until: UntilOption = None,
    around: AroundOption = None,
    radius: RadiusOption = None,
) -> str:
    """List the threats to an agent, and the yields to it and by it, that are feasible.

    Each line begins with the text for ``pd-editor generate --guide``.

    Args:
        scenario: A demo's name, an Argoverse 2 scenario folder, or a file of another format.
        to: Id of the agent, which keeps its trajectory; by default the ego.
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
        around: Metres in the file's frame, about which a square of its map is used; for maps beyond the limits of a scene.
        radius: Half the side of that square.
    """
    opened = open_scenario(
        scenario, current_s=current, until_s=until, around=around, radius_m=radius
    )
    if to:
        opened.agents.rows((to,))
    agent_id = endangered_id(opened, (to,) if to else ())
    if agent_id is None or (to and agent_id != to):
        raise EditError(f"--to: {to or 'the ego'} is not there at t = 0.")
    found = possible_encounters(opened, agent_id)
    lines = [f"{text_of(one.term)}  {one.in_words}" for one in found]
    return "\n".join(lines) or f"Nothing is feasible for agent {agent_id}."
