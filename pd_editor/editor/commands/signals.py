"""Commands that give the junctions of a scene their phases."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import Command
from pd_editor.scene.generation import MAX_SEED
from pd_editor.scene.junction_phases import sampled_signals, signals_with_green
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal


class _SignalCommand(Command):
    """A command that changes signals alone."""

    is_beyond_locks: ClassVar[bool] = True

    @abstractmethod
    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:
        """Signals that the scenario has afterwards."""

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with these signals."""
        return replace(scenario, signals=self.signals(scenario))


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleSignals(_SignalCommand):
    """Sample a plausible phase of each junction; replaces earlier signals."""

    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= MAX_SEED:
            raise EditError(f"The seed is {self.seed}; expected 0 to {MAX_SEED}.")

    @property
    def label(self) -> str:
        """Label with the seed."""
        return f"Sample signals, seed {self.seed}"

    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:
        """Signals of all junctions."""
        found = sampled_signals(scenario, self.seed)
        if not found:
            raise EditError(
                "No junction of this map has lanes that cross; expected one for signals."
            )
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class GiveGreen(_SignalCommand):
    """Give a lane green, and the other lanes of its junction what its phase tells."""

    lane_id: int

    @property
    def label(self) -> str:
        """Label with the lane."""
        return f"Green for lane {self.lane_id}"

    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:
        """Signals after the change."""
        found = signals_with_green(scenario, self.lane_id)
        if found is None:
            raise EditError(
                f"Lane {self.lane_id} leads into no junction with lanes that cross; "
                "expected a lane of one, or before one."
            )
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class RemoveSignals(_SignalCommand):
    """Remove all signals."""

    @property
    def label(self) -> str:
        """Short text."""
        return "Remove signals"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario without signals."""
        return super().apply(scenario) if scenario.signals else scenario

    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:  # noqa: ARG002
        """None at all."""
        return ()
