"""``pd-editor threats``: list what could happen to an agent."""

from dataclasses import dataclass, field
from typing import Annotated

from pd_editor.analysis.guidance.possible_encounters import (
    endangered_id,
    possible_encounters,
)
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.base.errors import EditError
from pd_editor.cli.options import PartOptions, ScenarioArgument, shown, taking, text_of
from pd_editor.editor.scenario_store import open_part
from pd_editor.scene.guidance_terms import PairGuidance
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class ThreatOptions(PartOptions):
    """Options of ``pd-editor threats``.

    Args:
        scenario: A demo's name, an Argoverse 2 scenario folder, or a file of another format.
        to: Id of the agent, which keeps its trajectory.
    """

    scenario: ScenarioArgument = field(kw_only=False)
    to: Annotated[str, shown("ID", "(default: the ego)")] = ""


@taking(ThreatOptions)
def threats(options: ThreatOptions) -> str:
    """List the threats to an agent, and the yields to it and by it, that are feasible.

    Each line begins with the text for --guide of pd-editor generate. Lines that end with
    --agents need that, too, so that the other agent keeps its trajectory.
    """
    opened, to = open_part(options.scenario, options.cut), options.to
    if to:
        opened.agents.rows((to,))
    agent_id = endangered_id(opened, (to,) if to else ())
    if agent_id is None or (to and agent_id != to):
        raise EditError(f"--to: {to or 'the ego'} is not there at t = 0.")
    lines = [
        f"{text_of(one.term)}  {one.in_words}{_condition(opened, one.term)}"
        for one in possible_encounters(opened, agent_id)
    ]
    return "\n".join(lines) or f"Nothing is feasible for agent {agent_id}."


def _condition(opened: Scenario, term: PairGuidance) -> str:
    """What to add where a run of all agents, the other one included, is refused."""
    if guidance_problems(opened, (term,), drivable_agent_ids(opened)):
        return f"; with --agents {' '.join(term.guided_ids)}"
    return ""
