"""Trajectories of a scene while they are retimed."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.collisions.box_tests import (
    first_overlap,
    overlapping_pairs,
)
from pd_editor.analysis.repair.repairable import counted, repairable
from pd_editor.analysis.repair.yielding import yielding
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.paths.retiming import (
    STANDING_EXTENT_M,
    fill_gaps,
    fill_heading_gaps,
    retime,
    travelled_m,
)
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectories:
    """Trajectories of a scene's agents, some of which may be slowed along their paths."""

    scenario: Scenario
    may_change: Bool[np.ndarray, "A"]
    changed: frozenset[int] = frozenset()
    """Rows that were retimed."""

    @property
    def agents(self) -> AgentTracks:
        """All agents after the changes so far."""
        return self.scenario.agents

    def moving_rows(self) -> Int[np.ndarray, "G"]:
        """Rows that may change and are not stationary."""
        step = self.scenario.current_step
        rows = np.flatnonzero(self.may_change)
        curve = fill_gaps(
            self.agents.position_m[rows, step:], self.agents.is_valid[rows, step:]
        )
        extent = np.linalg.norm(curve - curve[:, :1], axis=-1).max(axis=1, initial=0)
        return rows[extent > STANDING_EXTENT_M]

    def paths(
        self, rows: Int[np.ndarray, "G"]
    ) -> tuple[
        Float[np.ndarray, "G H 2"], Float[np.ndarray, "G H"], Float[np.ndarray, "G H"]
    ]:
        """Positions, headings and travelled distance of rows, with gaps filled."""
        step = self.scenario.current_step
        is_valid = self.agents.is_valid[rows, step:]
        curve = fill_gaps(self.agents.position_m[rows, step:], is_valid)
        heading = fill_heading_gaps(self.agents.heading_rad[rows, step:], is_valid)
        return curve, heading, travelled_m(curve)

    def retimed(
        self,
        rows: Int[np.ndarray, "G"],
        distance_m: Float[np.ndarray, "G H"],
        speed_mps: Float[np.ndarray, "G H"],
    ) -> "Trajectories":
        """Move some agents to other distances along their own paths."""
        step = self.scenario.current_step
        agents = self.agents
        old = agents.position_m[rows], agents.heading_rad[rows]
        is_valid = agents.is_valid[rows, step:]
        position, heading, velocity = retime(
            old[0][:, step:],
            old[1][:, step:],
            is_valid,
            distance_m,
            self.scenario.time_axis.step_s,
            speed_mps,
        )
        position[:, 0], heading[:, 0] = old[0][:, step], old[1][:, step]
        now = agents.velocity_mps[rows, step]
        length = np.hypot(now[:, 0], now[:, 1])
        factor = np.minimum(speed_mps[:, 0] / np.maximum(length, 1e-9), 1.0)
        velocity[:, 0] = factor[:, None] * now
        past = slice(None, step)
        retimed = agents.with_rows(
            rows,
            position_m=np.concatenate([old[0][:, past], position], axis=1),
            heading_rad=np.concatenate([old[1][:, past], heading], axis=1),
            velocity_mps=np.concatenate(
                [agents.velocity_mps[rows, past], velocity], axis=1
            ),
        )
        return self._with(retimed, rows)

    def with_yielding(
        self,
        last_ids: Collection[str] = (),
        comfort_mps2: Mapping[str, tuple[float, float]] | None = None,
    ) -> "Trajectories":
        """Let agents yield where they would collide.

        Agents with ``last_ids`` or locked first seconds yield only if the other one
        cannot. Those of ``comfort_mps2`` accelerate and brake no harder than that where
        it is enough.
        """
        if not self.scenario.time_axis.num_future_steps:
            return self
        step, agents = self.scenario.current_step, self.agents
        is_kept = self.scenario.kept_steps()[:, step:]
        num_kept = is_kept[:, 1:].sum(axis=1)
        found = yielding(
            agents,
            step,
            self.may_change,
            self.scenario.time_axis.step_s,
            num_kept,
            np.isin(agents.ids, list(last_ids)) | (num_kept > 0),
            self._asked_mps2(comfort_mps2 or {}),
        )
        if not len(found.row):
            return self
        is_valid, is_kept = agents.is_valid[found.row, step:], is_kept[found.row]

        def later(recorded: np.ndarray, driven: np.ndarray) -> np.ndarray:
            there = is_valid.reshape(*is_valid.shape, *[1] * (driven.ndim - 2))
            driven = np.where(there, driven, 0.0)
            former = recorded[found.row]
            kept = is_kept.reshape(there.shape)
            driven = np.where(kept, former[:, step:], driven)
            return np.concatenate([former[:, :step], driven], axis=1)

        yielded = agents.with_rows(
            found.row,
            position_m=later(agents.position_m, found.position_m),
            heading_rad=later(agents.heading_rad, found.heading_rad),
            velocity_mps=later(agents.velocity_mps, found.velocity_mps),
        )
        return self._with(yielded, found.row)

    def _asked_mps2(
        self, comfort_mps2: Mapping[str, tuple[float, float]]
    ) -> Float[np.ndarray, "A 2"]:
        asked = np.full((len(self.agents), 2), np.inf)
        asked[self.agents.rows(comfort_mps2)] = list(comfort_mps2.values()) or np.inf
        return asked

    def _with(self, agents: AgentTracks, rows: Int[np.ndarray, "G"]) -> "Trajectories":
        return replace(
            self,
            scenario=self.scenario.with_agents(agents),
            changed=self.changed.union(rows.tolist()),
        )

    def conflicts(self) -> Int[np.ndarray, "P 2"]:
        """Pairs that collide later.

        Pairs that overlap now are left out, and so are tracks that begin later:
        recordings often lose an agent and find it again under another id.
        """
        now = self.scenario.current_step
        pairs, _ = first_overlap(self.agents, np.arange(now + 1, self.agents.num_steps))
        already = {tuple(pair) for pair in overlapping_pairs(self.agents, now).tolist()}
        new = np.array([tuple(pair) not in already for pair in pairs.tolist()], bool)
        there = np.all(self.agents.is_valid[pairs, now], axis=1)
        return pairs[counted(self.agents, pairs) & new & there]


def yield_to_others(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
    last_ids: Collection[str] = (),
    comfort_mps2: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Scenario, tuple[str, ...]]:
    """Let road users yield that would collide; all others are unchanged.

    Agents whose trajectory is locked never yield, and those with locked first seconds
    only later. These and agents with ``last_ids`` yield only if the other one cannot.
    Those of ``comfort_mps2`` accelerate and brake no harder than that where it is enough.

    Returns:
        The scene, and the sorted ids of the agents that were slowed.

    Raises:
        EditError: an id is not in the scenario.
    """
    trajectories = Trajectories(
        scenario=scenario,
        may_change=repairable(
            scenario, agent_ids, keep_ids, ROAD_USER_KINDS, keeps_beginnings=True
        ),
    )
    resolved = trajectories.with_yielding(last_ids, comfort_mps2)
    names = sorted(scenario.agents.ids[row] for row in resolved.changed)
    return resolved.scenario, tuple(names)
