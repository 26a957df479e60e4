"""Report of a repair: changes made, and problems that remain."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

RepairKind = Literal[
    "project-to-lanes",
    "separate-overlaps",
    "slow-for-gaps",
    "retime-trajectories",
    "retime-for-comfort",
]


@dataclass(frozen=True, kw_only=True)
class RepairChange:
    """Change of one agent."""

    repair: RepairKind
    agent_id: str
    shift_m: float
    """Distance between old and new position: now, or at the end if retimed."""
    turn_deg: float
    """Change of the current heading, counter-clockwise."""
    slowdown_mps: float
    """Largest decrease of the agent's speed over all steps."""
    message: str
    """One sentence for the user."""


@dataclass(frozen=True, kw_only=True)
class RepairProblem:
    """Problem that could not be repaired."""

    repair: RepairKind
    agent_ids: tuple[str, ...]
    message: str
    """One sentence for the user."""


@dataclass(frozen=True, kw_only=True)
class RepairReport:
    """Changes and remaining problems, in the order of the agents."""

    changes: tuple[RepairChange, ...] = ()
    problems: tuple[RepairProblem, ...] = ()

    def joined(self, other: "RepairReport") -> "RepairReport":
        """Concatenate this report and another one."""
        return RepairReport(
            changes=self.changes + other.changes,
            problems=self.problems + other.problems,
        )


def name_of(agents: AgentTracks, row: int) -> str:
    """Kind and id of an agent, for the middle of a sentence."""
    return f"{agents.kinds[row].value.replace('_', ' ')} {agents.ids[row]}"


def sentence(text: str) -> str:
    """Capitalise a text and add a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def repairable(
    scenario: Scenario,
    agent_ids: Iterable[str] | None,
    keep_ids: Collection[str] | None,
    kinds: Collection[AgentKind] = LANE_FOLLOWER_KINDS,
    *,
    keeps_beginnings: bool = False,
) -> Bool[np.ndarray, "A"]:
    """Which agents may be repaired: present ones of ``kinds`` in ``agent_ids`` (None: all).

    Agents in ``keep_ids`` are left out; None means the focal agent. Locked agents are
    left out as well; if the repair keeps the beginnings of trajectories, only those with a
    locked trajectory.

    Raises:
        EditError: an id is not in the scenario.
    """
    agents = scenario.agents
    asked = np.zeros(len(agents), bool)
    asked[agents.rows(agents.ids if agent_ids is None else agent_ids)] = True
    if keep_ids is None:
        keep_ids = {scenario.focal_id} & set(agents.ids)
    asked[agents.rows(keep_ids)] = False
    asked[
        agents.rows(
            name
            for name, lock in scenario.locks.items()
            if lock.keeps_trajectory or not keeps_beginnings
        )
    ] = False
    return asked & agents.kind_mask(kinds) & agents.is_valid[:, scenario.current_step]
