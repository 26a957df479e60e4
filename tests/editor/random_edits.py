"""Random edits that apply, for long walks."""

import numpy as np

from pd_editor.editor.commands import (
    Command,
    DeleteAgents,
    DuplicateAgents,
    PlaceAgent,
    SetAgentSpeed,
    TransformAgents,
    new_agent_id,
    new_agent_ids,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import present_ids


def random_command(scenario: Scenario, rng: np.random.Generator) -> Command:
    """A cheap edit that applies."""
    ids = present_ids(scenario)
    name = ids[rng.integers(len(ids))]
    deletable = [one for one in ids if one != scenario.focal_id]
    options = [
        TransformAgents(
            agent_ids=(name,),
            dx_m=float(rng.normal()),
            dy_m=float(rng.normal()),
            rotation_rad=float(rng.normal() / 5),
        ),
        SetAgentSpeed(agent_ids=(name,), speed_mps=float(rng.uniform(0, 15))),
        DuplicateAgents(
            agent_ids=(name,), new_ids=new_agent_ids(scenario, 1, "copy"), dx_m=4.0
        ),
        PlaceAgent(
            agent_id=new_agent_id(scenario),
            kind=AgentKind.CYCLIST,
            x_m=float(rng.uniform(-50, 50)),
            y_m=0.0,
            heading_rad=0.0,
            speed_mps=5.0,
        ),
    ]
    if deletable:
        gone = deletable[rng.integers(len(deletable))]
        options.append(DeleteAgents(agent_ids=(gone,)))
    return options[rng.integers(len(options))]
