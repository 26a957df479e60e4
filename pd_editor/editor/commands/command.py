"""What every edit is: a serialisable value that turns a scenario into another."""

from abc import ABC, abstractmethod
from typing import Final

from pd_editor.editor.commands.json_values import to_json
from pd_editor.scene.scenario import Scenario

MAX_NAMED: Final = 3
"""Agents that a label names; more are only counted."""
MAX_NAME_CHARACTERS: Final = 20


class Command(ABC):
    """One edit. Subclasses are frozen dataclasses whose fields have a JSON form."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Short text for a list of edits, such as "Move 3 agents"."""

    def label_after(self, before: Scenario) -> str:  # noqa: ARG002
        """Short text of what the edit changes in the scenario that it is applied to."""
        return self.label

    @property
    def edits_current_state(self) -> bool:
        """Whether it says where agents are, or how fast, at the current step."""
        return False

    @property
    def selects(self) -> tuple[str, ...] | None:
        """Agents to select afterwards; None keeps the selection."""
        return None

    @abstractmethod
    def apply(self, scenario: Scenario) -> Scenario:
        """The edited scenario; ``scenario`` itself where there is nothing to change.

        Raises:
            EditError: the edit makes no sense on this scenario.
        """

    def __eq__(self, other: object) -> bool:
        """Same class, same values; used by commands that hold arrays."""
        return type(self) is type(other) and to_json(self) == to_json(other)

    def __hash__(self) -> int:
        return hash(type(self))


def agents_in_words(agent_ids: tuple[str, ...]) -> str:
    """Names one agent, counts several."""
    if len(agent_ids) == 1:
        return f"agent {shortened(agent_ids[0])}"
    return f"{len(agent_ids)} agents"


def names_after(agent_ids: tuple[str, ...]) -> str:
    """The first names of several agents, to stand in brackets after a label."""
    if len(agent_ids) < 2:
        return ""
    named = [shortened(name) for name in agent_ids[:MAX_NAMED]]
    if len(agent_ids) > MAX_NAMED:
        named.append("...")
    return f" ({', '.join(named)})"


def shortened(agent_id: str) -> str:
    """An id that fits a label."""
    if len(agent_id) <= MAX_NAME_CHARACTERS:
        return agent_id
    return f"{agent_id[: MAX_NAME_CHARACTERS - 3]}..."
