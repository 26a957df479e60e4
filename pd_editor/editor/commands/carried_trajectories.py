"""Finds agents whose trajectory was generated for another current state."""

from collections.abc import Iterable

from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.motion import AdoptTrajectory
from pd_editor.editor.commands.poses import (
    SetAgentHeading,
    SetAgentPosition,
    SnapToLane,
    TransformAgents,
)
from pd_editor.editor.commands.traffic import ReplaceTraffic


def carried_agent_ids(commands: Iterable[Command]) -> frozenset[str]:
    """Ids of agents whose trajectory was moved together with their pose.

    An agent leaves the set when its trajectory is regenerated.
    """
    carried: set[str] = set()
    for command in commands:
        if isinstance(command, TransformAgents | SetAgentHeading | SnapToLane):
            carried.update(command.agent_ids)
        elif isinstance(command, SetAgentPosition):
            carried.add(command.agent_id)
        elif isinstance(command, AdoptTrajectory):
            carried.discard(command.agent_id)
        elif isinstance(command, ReplaceTraffic):
            carried.difference_update(command.sample.ids)
    return frozenset(carried)
