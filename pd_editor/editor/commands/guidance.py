"""Commands that add, change and remove guidance terms."""

from dataclasses import dataclass, replace

from pd_editor.analysis.guidance.kinds.path import FollowLane
from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import Command
from pd_editor.scene.guidance_terms import MAX_TERMS, GuidanceTerm
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class AddGuidance(Command):
    """Add a guidance term after the present ones."""

    term: GuidanceTerm

    @property
    def label(self) -> str:
        """Label with the term."""
        return f"Add {self.term.in_words}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with one more term."""
        _check_term(scenario, self.term)
        if len(scenario.guidance) >= MAX_TERMS:
            raise EditError(
                f"There are {len(scenario.guidance)} guidance terms already; at most "
                f"{MAX_TERMS} are possible."
            )
        return replace(scenario, guidance=(*scenario.guidance, self.term))


@dataclass(frozen=True, kw_only=True)
class ChangeGuidance(Command):
    """Replace a guidance term, given by its index."""

    index: int
    term: GuidanceTerm

    @property
    def label(self) -> str:
        """Label with the new term."""
        return f"Change {self.term.in_words}"

    def label_after(self, before: Scenario) -> str:
        """Label that tells switching and weighing from other changes."""
        if not 0 <= self.index < len(before.guidance):
            return self.label
        old = before.guidance[self.index]
        if replace(old, is_on=self.term.is_on) == self.term:
            return f"Switch {self.term.in_words} {'on' if self.term.is_on else 'off'}"
        if replace(old, weight=self.term.weight) == self.term:
            return f"Strength of {self.term.in_words}: {self.term.weight:g}"
        return self.label

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the new term in the place of the old one."""
        _check_index(scenario, self.index)
        if scenario.guidance[self.index] == self.term:
            return scenario
        _check_term(scenario, self.term)
        terms = list(scenario.guidance)
        terms[self.index] = self.term
        return replace(scenario, guidance=tuple(terms))


@dataclass(frozen=True, kw_only=True)
class RemoveGuidance(Command):
    """Remove a guidance term, given by its index."""

    index: int

    @property
    def label(self) -> str:
        """Label without the term, which is known to the scenario only."""
        return f"Remove guidance term {self.index + 1}"

    def label_after(self, before: Scenario) -> str:
        """Label with the removed term."""
        if 0 <= self.index < len(before.guidance):
            return f"Remove {before.guidance[self.index].in_words}"
        return self.label

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario without the term."""
        _check_index(scenario, self.index)
        terms = list(scenario.guidance)
        del terms[self.index]
        return replace(scenario, guidance=tuple(terms))


def _check_index(scenario: Scenario, index: int) -> None:
    if not 0 <= index < len(scenario.guidance):
        count = len(scenario.guidance)
        raise EditError(
            f"There is no guidance term {index + 1}; the scenario has {count}."
        )


def _check_term(scenario: Scenario, term: GuidanceTerm) -> None:
    """Raise for terms of agents and lanes that are not in the scenario."""
    agents = scenario.agents
    gone = [name for name in term.named_ids if name not in agents.row_of]
    if gone:
        raise EditError(f"There is no agent {gone[0]!r} here for the {term.name}.")
    if isinstance(term, FollowLane):
        lanes = scenario.road_map.lane_of
        missing = [lane_id for lane_id in term.lane_ids if lane_id not in lanes]
        if missing:
            raise EditError(f"There is no lane {missing[0]} on this map.")
