"""Finds agents with generated trajectories, and those carried to another state."""

from collections.abc import Iterable

from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.motion import AdoptTrajectory, PullSpeed
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
    for command in _parts(commands):
        if isinstance(command, TransformAgents | SetAgentHeading | SnapToLane):
            carried.update(command.agent_ids)
        elif isinstance(command, SetAgentPosition):
            carried.add(command.agent_id)
        elif isinstance(command, AdoptTrajectory):
            carried.discard(command.agent_id)
        elif isinstance(command, ReplaceTraffic):
            carried.difference_update(command.sample.ids)
    return frozenset(carried)


def generated_agent_ids(commands: Iterable[Command]) -> frozenset[str]:
    """Ids of agents whose trajectory is generated, and not chosen by hand since."""
    generated: set[str] = set()
    for command in _parts(commands):
        if isinstance(command, ReplaceTraffic):
            generated.update(command.sample.ids)
        elif isinstance(command, AdoptTrajectory | PullSpeed):
            generated.discard(command.agent_id)
    return frozenset(generated)


def _parts(commands: Iterable[Command]) -> Iterable[Command]:
    return (part for command in commands for part in command.parts)
