"""Placed agents that break a rule are found, and the best of their versions taken."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from pd_editor.analysis.repair.state_repairs import GAP_M
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.kept_paths import KeptPaths
from pd_editor.generation.initial_state.placement_rules import (
    PLACEMENT_RULES,
    ConflictResampling,
    PlacedTraffic,
    PlacementRule,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class ConflictSearch:
    """Search for placed agents that break any of some rules."""

    settings: ConflictResampling
    gap_m: float
    """Boxes nearer than this to each other conflict."""
    rules: Sequence[PlacementRule] = PLACEMENT_RULES

    @classmethod
    def of(
        cls,
        settings: ConflictResampling,
        guidance: InitialStateGuidance,
        rules: Sequence[PlacementRule] = PLACEMENT_RULES,
    ) -> "ConflictSearch":
        """Search with a gap half-way between those of guidance and of repairs."""
        return cls(settings=settings, gap_m=(guidance.gap_m + GAP_M) / 2, rules=rules)

    def conflicting(
        self,
        scenario: Scenario,
        placed_ids: Collection[str],
        random: np.random.Generator,
        kept: KeptPaths,
    ) -> tuple[str, ...]:
        """Placed agents without which no placed agent is in conflict.

        Agents with most conflicts come first; of equal ones any may be chosen.
        """
        agents, step = scenario.agents, scenario.current_step
        rows = np.flatnonzero(
            agents.is_valid[:, step] & agents.kind_mask(LANE_FOLLOWER_KINDS)
        )
        agents = agents.taken(rows)
        placed = frozenset(placed_ids)
        may_go = np.array([name in placed for name in agents.ids], bool)
        remains = self.conflicts(agents, scenario, kept)
        chosen: list[str] = []
        while True:
            number = remains.sum(axis=1) * may_go
            if not number.any():
                return tuple(chosen)
            row = int(random.choice(np.flatnonzero(number == number.max())))
            chosen.append(agents.ids[row])
            remains[row], remains[:, row] = False, False

    def best_of(
        self,
        versions: Sequence[Scenario],
        agent_ids: Collection[str],
        kept: KeptPaths,
    ) -> Scenario:
        """Scenario in which each of some agents has its state of one version.

        Versions differ in the states of these agents only. First comes the version with
        fewest conflicts; an agent in conflict then gets its state of another version if
        that has fewer.
        """
        if len(versions) == 1:
            return versions[0]
        agents, step = versions[0].agents, versions[0].current_step
        own = agents.rows(tuple(agent_ids))
        states = agents
        for number, version in enumerate(versions):
            again = version.agents.taken(version.agents.rows(tuple(agent_ids)))
            names = tuple(f"{number}/{name}" for name in again.ids)
            states = states.joined(replace(again, ids=names))
        found = self.conflicts(states, versions[0], kept)
        counts = states.is_valid[:, step] & states.kind_mask(LANE_FOLLOWER_KINDS)
        found &= counts & counts[:, None]
        # Row of each agent's state in each version; other agents have one state only.
        table = len(agents) + np.arange(len(versions) * len(own)).reshape(-1, len(own))
        rows = np.arange(len(agents))
        totals: list[int] = []
        for candidates in table:
            rows[own] = candidates
            totals.append(int(found[np.ix_(candidates, rows)].sum()))
        rows[own] = table[np.argmin(totals)]
        for row, candidates in zip(own, table.T, strict=True):
            others = np.delete(rows, row)
            number = found[np.ix_(candidates, others)].sum(axis=1)
            number += found[candidates, candidates]
            used = int(np.flatnonzero(candidates == rows[row])[0])
            if number.min() < number[used]:
                rows[row] = candidates[number.argmin()]
        return versions[0].with_agents(replace(states.taken(rows), ids=agents.ids))

    def conflicts(
        self, agents: AgentTracks, scenario: Scenario, kept: KeptPaths
    ) -> Bool[np.ndarray, "A A"]:
        """Which pairs break a rule, and on the diagonal which agents break one alone.

        Symmetric. The agents are on the road of the scenario, at its current step.
        """
        traffic = self.traffic(agents, scenario, kept)
        found = np.zeros((len(agents), len(agents)), bool)
        for rule in self.rules:
            found |= rule.offenders(traffic)
        return found | found.T

    def traffic(
        self, agents: AgentTracks, scenario: Scenario, kept: KeptPaths
    ) -> PlacedTraffic:
        """What rules look at."""
        return PlacedTraffic(
            agents=agents,
            scenario=scenario,
            kept=kept,
            settings=self.settings,
            gap_m=self.gap_m,
        )
