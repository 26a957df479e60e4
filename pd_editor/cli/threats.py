"""``pd-editor threats``: list what could happen to an agent."""

from dataclasses import dataclass, field
from typing import Annotated

from pd_editor.analysis.guidance.possible_encounters import (
    endangered_id,
    possible_encounters,
)
from pd_editor.base.errors import EditError
from pd_editor.cli.options.arguments import (
    PartOptions,
    ScenarioArgument,
    shown,
    taking,
)
from pd_editor.cli.options.guide_option import text_of
from pd_editor.editor.scenario_store import open_part


@dataclass(frozen=True, kw_only=True)
class ThreatOptions(PartOptions):
    """Options of ``pd-editor threats``.

    Args:
        scenario: A demo's name, an Argoverse 2 scenario folder, or a file of another format.
        to: Id of the agent, which keeps its trajectory; by default the ego.
    """

    scenario: ScenarioArgument = field(kw_only=False)
    to: Annotated[str, shown("ID")] = ""


@taking(ThreatOptions)
def threats(options: ThreatOptions) -> str:
    """List the threats to an agent, and the yields to it and by it, that are feasible.

    Each line begins with the text for ``pd-editor generate --guide``.
    """
    opened, to = open_part(options.scenario, options.cut), options.to
    if to:
        opened.agents.rows((to,))
    agent_id = endangered_id(opened, (to,) if to else ())
    if agent_id is None or (to and agent_id != to):
        raise EditError(f"--to: {to or 'the ego'} is not there at t = 0.")
    found = possible_encounters(opened, agent_id)
    lines = [f"{text_of(one.term)}  {one.in_words}" for one in found]
    return "\n".join(lines) or f"Nothing is feasible for agent {agent_id}."
