"""Table of all commands, and their JSON form."""

from typing import Any, Final

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands.agents import (
    DeleteAgents,
    DuplicateAgents,
    RemoveAllAgents,
    SetAgentActivity,
    SetAgentKind,
    SetAgentSize,
    SetFocalAgent,
    new_agent_id,
    new_agent_ids,
)
from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.guidance import (
    AddGuidance,
    ChangeGuidance,
    RemoveGuidance,
)
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.editor.commands.locks import SetLocks
from pd_editor.editor.commands.motion import (
    AdoptTrajectory,
    PullSpeed,
    SetAgentSpeed,
    SlowToComfort,
    SlowToFrictionLimit,
    YieldToOthers,
)
from pd_editor.editor.commands.poses import (
    PlaceAgent,
    SetAgentHeading,
    SetAgentPosition,
    SnapToLane,
    TransformAgents,
)
from pd_editor.editor.commands.road import (
    GiveGreen,
    RemoveSignals,
    SampleSignals,
    SetRoadWarp,
)
from pd_editor.editor.commands.roll_out import BeginAt, ContinueScene
from pd_editor.editor.commands.traffic import (
    RegeneratedEdit,
    ReplaceTraffic,
    RequestSummary,
    traffic_command,
)

COMMANDS: Final[dict[str, type[Command]]] = {
    command.__name__: command
    for command in (
        SetRoadWarp,
        SampleSignals,
        GiveGreen,
        RemoveSignals,
        TransformAgents,
        SetAgentPosition,
        SetAgentHeading,
        SnapToLane,
        SetAgentSpeed,
        PullSpeed,
        SlowToFrictionLimit,
        SlowToComfort,
        YieldToOthers,
        AdoptTrajectory,
        SetAgentActivity,
        SetAgentKind,
        SetAgentSize,
        PlaceAgent,
        DuplicateAgents,
        DeleteAgents,
        RemoveAllAgents,
        SetFocalAgent,
        AddGuidance,
        ChangeGuidance,
        RemoveGuidance,
        SetLocks,
        ReplaceTraffic,
        RegeneratedEdit,
        ContinueScene,
        BeginAt,
    )
}
"""All commands by their names in recipes."""
_PARTS: Final = ("edit", "traffic")

__all__ = [
    "COMMANDS",
    "AddGuidance",
    "AdoptTrajectory",
    "BeginAt",
    "ChangeGuidance",
    "Command",
    "ContinueScene",
    "DeleteAgents",
    "DuplicateAgents",
    "PlaceAgent",
    "PullSpeed",
    "RegeneratedEdit",
    "RemoveAllAgents",
    "RemoveGuidance",
    "ReplaceTraffic",
    "RequestSummary",
    "SetAgentActivity",
    "SetAgentHeading",
    "SetAgentKind",
    "SetAgentPosition",
    "SetAgentSize",
    "SetAgentSpeed",
    "SetFocalAgent",
    "SetLocks",
    "SetRoadWarp",
    "SlowToComfort",
    "SlowToFrictionLimit",
    "SnapToLane",
    "TransformAgents",
    "YieldToOthers",
    "command_from_json",
    "command_to_json",
    "new_agent_id",
    "new_agent_ids",
    "traffic_command",
]


def command_to_json(command: Command) -> dict[str, Any]:
    """Convert a command to its name and fields."""
    if isinstance(command, RegeneratedEdit):
        parts = {name: command_to_json(getattr(command, name)) for name in _PARTS}
        return {"command": type(command).__name__, **parts}
    return {"command": type(command).__name__, **to_json(command)}


def command_from_json(data: Any, where: str) -> Command:
    """Convert JSON to a command; inverse of ``command_to_json``.

    Raises:
        RecipeError: unknown command or bad fields; the sentence starts with ``where``.
    """
    if not isinstance(data, dict) or not isinstance(data.get("command"), str):
        raise RecipeError(f"{where} must be an object that names its command.")
    name = data["command"]
    if name not in COMMANDS:
        raise RecipeError(f"{where} is of the unknown command {name!r}.")
    values = {key: value for key, value in data.items() if key != "command"}
    if COMMANDS[name] is RegeneratedEdit:
        return _regenerated_edit(values, f"{where} ({name})")
    return from_json(COMMANDS[name], values, f"{where} ({name})")


def _regenerated_edit(values: dict[str, Any], where: str) -> RegeneratedEdit:
    if set(values) != set(_PARTS):
        raise RecipeError(f"{where} must have exactly the fields {_PARTS}.")
    if any(_names(one, RegeneratedEdit) for one in values.values()):
        raise RecipeError(
            f"{where} must not contain another {RegeneratedEdit.__name__}."
        )
    edit, traffic = (
        command_from_json(values[name], f"{where}.{name}") for name in _PARTS
    )
    if not isinstance(traffic, ReplaceTraffic):
        raise RecipeError(f"{where}.traffic must be a {ReplaceTraffic.__name__}.")
    return RegeneratedEdit(edit=edit, traffic=traffic)


def _names(data: Any, command: type[Command]) -> bool:
    return isinstance(data, dict) and data.get("command") == command.__name__
