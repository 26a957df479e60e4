"""Command of an edit together with the traffic that was regenerated for it."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pd_editor.analysis.metrics.traffic_view import SAME_STATE_M
from pd_editor.editor.commands.command import Command, agents_in_words
from pd_editor.editor.commands.traffic import ReplaceTraffic
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.scenario import Scenario

_SAME_HEADING_RAD: Final = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class RegeneratedEdit(Command):
    """Apply an edit, then the trajectories that agents got in reaction to it."""

    edit: Command
    traffic: ReplaceTraffic

    @property
    def label(self) -> str:
        """Label of the edit, with the agents whose trajectories were regenerated."""
        return self._labelled(self.edit.label)

    def label_after(self, before: Scenario) -> str:
        """The same, relative to the scenario before the edit."""
        return self._labelled(self.edit.label_after(before))

    @property
    def edits_current_state(self) -> bool:
        """Whether the edit sets poses or speeds at the current step."""
        return self.edit.edits_current_state

    @property
    def is_beyond_locks(self) -> bool:
        """Whether the edit moves the road with all agents on it."""
        return self.edit.is_beyond_locks

    @property
    def selects(self) -> tuple[str, ...] | None:
        """Ids of the agents that the edit selects."""
        return self.edit.selects

    @property
    def parts(self) -> tuple[Command, ...]:
        """The edit and the regenerated traffic."""
        return self.edit, self.traffic

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the edit and the regenerated trajectories."""
        return self.traffic.apply(self.edit.apply(scenario))

    def _labelled(self, edit: str) -> str:
        return f"{edit}, {agents_in_words(self.traffic.sample.ids)} regenerated"


def carried_to(sample: TrafficSample, scenario: Scenario) -> TrafficSample:
    """Move each trajectory rigidly so that it continues what is fixed of its agent.

    That is the present pose, or for agents with locked seconds the last locked one. All
    agents of the sample must be in the scenario.
    """
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(sample.ids)
    kept = scenario.kept_steps()[rows, now:].sum(axis=1)
    last = np.clip(kept - 1, 0, sample.heading_rad.shape[1] - 1)
    each = np.arange(len(rows))
    here = sample.position_m[each, last]
    start = agents.position_m[rows, now + last]
    turn = wrap_angle(
        agents.heading_rad[rows, now + last] - sample.heading_rad[each, last]
    )
    gap_m = np.hypot(*(start - here).T)
    if (gap_m < SAME_STATE_M).all() and (np.abs(turn) < _SAME_HEADING_RAD).all():
        return sample
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]

    def rotated(vectors: np.ndarray) -> np.ndarray:
        x, y = vectors[..., 0], vectors[..., 1]
        return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)

    position = start[:, None] + rotated(sample.position_m - here[:, None])
    # The traffic is applied where it begins at the present state.
    is_locked = last > 0
    position[is_locked, 0] = agents.position_m[rows[is_locked], now]
    return replace(
        sample,
        position_m=position,
        heading_rad=wrap_angle(sample.heading_rad + turn[:, None]),
        velocity_mps=rotated(sample.velocity_mps),
    )
