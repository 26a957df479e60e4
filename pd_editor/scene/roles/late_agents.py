"""Agents that enter a recording after the current step.

Recordings lose agents and find them again under another id. A late agent that continues
the track of an earlier one is the same agent: where that one gets another trajectory, the
late one is no obstacle.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

_LEAST_GAP_M: Final = 2.5
"""A track continues another one that would have come as close to its first position."""
_GAP_MPS: Final = 1.5
"""Additional distance for each second between the two tracks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LateAgents:
    """L agents that enter after the current step, and what is known of them before.

    Their motion before they enter is extended backwards at constant velocity.
    """

    row: Int[np.ndarray, "L"]
    entry_step: Int[np.ndarray, "L"]
    continues: Bool[np.ndarray, "L A"]
    """Whether a late agent continues the track of each agent of the scenario."""

    @classmethod
    def of(cls, scenario: Scenario) -> "LateAgents":
        """All late agents of a scenario."""
        agents, now = scenario.agents, scenario.current_step
        is_late = ~agents.is_valid[:, now] & agents.is_valid[:, now:].any(axis=1)
        row = np.flatnonzero(is_late)
        entry = now + agents.is_valid[row, now:].argmax(axis=1)
        return cls(
            row=row,
            entry_step=entry,
            continues=_continues(
                agents, row, entry, current_step=now, step_s=scenario.time_axis.step_s
            ),
        )

    def but_continuing(self, rows: Int[np.ndarray, "G"]) -> "LateAgents":
        """Those that continue the track of none of some agents."""
        return self._taken(~self.continues[:, rows].any(axis=1))

    def continuing(self, rows: Int[np.ndarray, "G"]) -> "LateAgents":
        """Those that continue the track of any of some agents."""
        return self._taken(self.continues[:, rows].any(axis=1))

    def entering_by(self, step: int) -> "LateAgents":
        """Those that enter at a step or before."""
        return self._taken(self.entry_step <= step)

    def _taken(self, some: Any) -> "LateAgents":
        return LateAgents(
            row=self.row[some],
            entry_step=self.entry_step[some],
            continues=self.continues[some],
        )

    def extended_backwards(self, scenario: Scenario) -> AgentTracks:
        """The scenario's agents, the late ones extended back to the current step."""
        agents, axis = scenario.agents, scenario.time_axis
        if not len(self.row):
            return agents
        every, entry = np.arange(len(self.row)), self.entry_step
        now, rows = axis.current_step, self.row
        steps = np.arange(agents.num_steps)
        is_before = (steps >= now) & (steps < entry[:, None])
        ahead_s = (steps - entry[:, None]) * axis.step_s
        position = agents.position_m[rows].copy()
        heading = agents.heading_rad[rows].copy()
        velocity = agents.velocity_mps[rows].copy()
        first = velocity[every, entry][:, None]
        straight = position[every, entry][:, None] + ahead_s[..., None] * first
        mask = is_before[..., None]
        return agents.with_rows(
            rows,
            position_m=np.where(mask, straight, position),
            heading_rad=np.where(is_before, heading[every, entry][:, None], heading),
            velocity_mps=np.where(mask, first, velocity),
            is_valid=agents.is_valid[rows] | is_before,
        )


def _continues(
    agents: AgentTracks,
    row: Int[np.ndarray, "L"],
    entry_step: Int[np.ndarray, "L"],
    *,
    current_step: int,
    step_s: float,
) -> Bool[np.ndarray, "L A"]:
    """Whether each late agent continues the track of each agent that has left by then.

    Either track, extended at its velocity to the other's time, comes close to the other.
    """
    is_valid = agents.is_valid
    last = agents.num_steps - 1 - is_valid[:, ::-1].argmax(axis=1)
    every = np.arange(len(agents))
    pause_s: Float[np.ndarray, "L A"] = (entry_step[:, None] - last) * step_s
    gap = agents.position_m[row, entry_step][:, None] - agents.position_m[every, last]
    ahead = gap - pause_s[..., None] * agents.velocity_mps[every, last]
    back = gap - pause_s[..., None] * agents.velocity_mps[row, entry_step][:, None]
    nearest = np.minimum(np.hypot(*ahead.T).T, np.hypot(*back.T).T)
    kinds = np.array([str(kind) for kind in agents.kinds])
    left = (last >= current_step) & is_valid[every, last] & (pause_s > 0)
    same_kind = kinds[row][:, None] == kinds
    return left & same_kind & (nearest <= _LEAST_GAP_M + _GAP_MPS * pause_s)
