"""Base class of commands: serialisable values that edit a scenario."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import ClassVar, Final, TypeVar

from pd_editor.editor.commands.json_values import to_json
from pd_editor.scene.scenario import Scenario

MAX_NAMED: Final = 3
"""Number of agents that a label names; further ones are counted."""
MAX_NAME_CHARACTERS: Final = 20
_Command = TypeVar("_Command", bound="Command")


class Command(ABC):
    """An edit. Subclasses are frozen dataclasses whose fields have a JSON form."""

    is_beyond_locks: ClassVar[bool] = False
    """Whether it moves agents with the road alone, or none, so that locks permit it."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Short text for a list of edits, such as "Move 3 agents"."""

    def label_after(self, before: Scenario) -> str:  # noqa: ARG002
        """Short text of the change relative to the scenario before the edit."""
        return self.label

    @property
    def edits_current_state(self) -> bool:
        """Whether it, or a part of it, sets poses or speeds at the current step."""
        return any(isinstance(part, StateCommand) for part in self.parts)

    @property
    def parts(self) -> tuple["Command", ...]:
        """The commands of which it consists: itself, unless it applies several in turn."""
        return (self,)

    @property
    def selects(self) -> tuple[str, ...] | None:
        """Ids of the agents to select afterwards; None keeps the selection."""
        return None

    @abstractmethod
    def apply(self, scenario: Scenario) -> Scenario:
        """Edit a scenario; returns ``scenario`` itself if nothing changes.

        Raises:
            EditError: the edit is not valid for this scenario.
        """

    def __eq__(self, other: object) -> bool:
        """Whether class and values are equal; also for commands with arrays."""
        return type(self) is type(other) and to_json(self) == to_json(other)

    def __hash__(self) -> int:
        return hash(type(self))


class StateCommand(Command):
    """A command that sets poses or speeds at the current step."""


def parts_of(commands: Iterable[Command], kind: type[_Command]) -> list[_Command]:
    """All commands of a kind of which some consist, in the order of application."""
    parts = (part for command in commands for part in command.parts)
    return [part for part in parts if isinstance(part, kind)]


def agents_in_words(agent_ids: tuple[str, ...]) -> str:
    """Text with the id of one agent, or the number of several."""
    if len(agent_ids) == 1:
        return f"agent {shortened(agent_ids[0])}"
    return f"{len(agent_ids)} agents"


def names_after(agent_ids: tuple[str, ...]) -> str:
    """First ids of several agents, in brackets after a label."""
    if len(agent_ids) < 2:
        return ""
    named = [shortened(name) for name in agent_ids[:MAX_NAMED]]
    if len(agent_ids) > MAX_NAMED:
        named.append("...")
    return f" ({', '.join(named)})"


def shortened(agent_id: str) -> str:
    """Id, shortened for a label."""
    if len(agent_id) <= MAX_NAME_CHARACTERS:
        return agent_id
    return f"{agent_id[: MAX_NAME_CHARACTERS - 3]}..."
