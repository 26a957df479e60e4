"""What every edit is: a serialisable value that turns a scenario into another."""

from abc import ABC, abstractmethod

from pd_editor.editor.json_values import to_json
from pd_editor.scene.scenario import Scenario


class Command(ABC):
    """One edit. Subclasses are frozen dataclasses whose fields have a JSON form."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Short text for a list of edits, such as "Move 3 agents"."""

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
    return (
        f"agent {agent_ids[0]}" if len(agent_ids) == 1 else f"{len(agent_ids)} agents"
    )
