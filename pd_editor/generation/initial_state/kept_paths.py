"""Where agents drive whose trajectories are kept, and which placed agents are in their way."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.oriented_box import Boxes, BoxStates
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

_EVERY_STEPS: Final = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptPaths:
    """Boxes of K moving agents with kept trajectories, from the current step on."""

    boxes: BoxStates
    time_s: Float[np.ndarray, "S"]
    """Times after the current step."""

    @classmethod
    def of(cls, scenario: Scenario, generated_ids: Collection[str]) -> "KeptPaths":
        """All agents that move later, but those whose trajectories are generated."""
        agents, now = scenario.agents, scenario.current_step
        steps = np.arange(now, agents.num_steps, _EVERY_STEPS)
        speed = np.hypot(*np.moveaxis(agents.velocity_mps[:, steps], -1, 0))
        moves = (agents.is_valid[:, steps] & (speed >= MOVING_MPS)).any(axis=1)
        generated = agents.rows(tuple(generated_ids))
        late = LateAgents.of(scenario)
        moves[generated] = False
        # What enters later at the place of such an agent may be that agent, tracked again.
        moves[np.setdiff1d(late.row, late.but_continuing(generated).row)] = False
        return cls(
            boxes=agents.taken(np.flatnonzero(moves)).at_steps(steps),
            time_s=(steps - now) * scenario.time_axis.step_s,
        )

    def blocked_by(
        self, agents: AgentTracks, step: int, *, ahead_s: float, gap_m: float
    ) -> Bool[np.ndarray, "A"]:
        """Which agents, with their states at a step, are in the way of any of the K.

        One that stands is there all the time; one that moves is followed at constant
        velocity for ``ahead_s``. ``gap_m`` is the least distance of boxes.
        """
        kept, velocity = self.boxes, agents.velocity_mps[:, step]
        moves = np.hypot(*velocity.T) >= MOVING_MPS
        there = ~moves[:, None] | (self.time_s <= ahead_s)
        drift = np.where(moves[:, None], velocity, 0.0)
        place = agents.position_m[:, step, None] + drift[:, None] * self.time_s[:, None]
        boxes = Boxes(
            position_m=place,
            heading_rad=np.broadcast_to(
                agents.heading_rad[:, step, None], place.shape[:2]
            ),
            size_m=agents.size_m[:, None] + 2 * gap_m,
        )
        offset = place[:, None] - kept.position_m
        near = np.hypot(offset[..., 0], offset[..., 1]) < (
            boxes.radius_m[:, None] + kept.radius_m[:, None]
        )
        near &= there[:, None] & kept.is_valid
        agent, other, at = np.nonzero(near)
        touch = boxes_touch(boxes[agent, at], kept.at(other, at))
        return np.isin(np.arange(len(agents)), agent[touch])
