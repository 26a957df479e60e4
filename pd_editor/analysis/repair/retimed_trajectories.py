"""Trajectories of a scene while they are retimed: to yield, or to be comfortable."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import first_overlap, overlapping_pairs
from pd_editor.analysis.metrics.motion import (
    COMFORT,
    WINDOW_STEPS,
    derivative_operators,
    kinematics,
)
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.analysis.repair.current_states import counted, repairable
from pd_editor.analysis.repair.yielding import yielding
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.paths.retiming import (
    fill_gaps,
    fill_heading_gaps,
    slowed_to_limits,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVED_M

SHARES: Final = (0.9, 0.75, 0.6, 0.45)
"""Shares of the limits that are tried in turn, until the motion is within the limits."""


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
        return rows[extent > MOVED_M]

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
        motion = found.position_m, found.heading_rad, found.velocity_mps
        at = agents.is_valid[found.row, step:] & ~is_kept[found.row]
        return self.with_agents(
            agents.with_motion(found.row, step, motion, at), found.row
        )

    def _asked_mps2(
        self, comfort_mps2: Mapping[str, tuple[float, float]]
    ) -> Float[np.ndarray, "A 2"]:
        asked = np.full((len(self.agents), 2), np.inf)
        asked[self.agents.rows(comfort_mps2)] = list(comfort_mps2.values()) or np.inf
        return asked

    def with_agents(
        self, agents: AgentTracks, rows: Int[np.ndarray, "G"]
    ) -> "Trajectories":
        """The trajectories after a change of some rows."""
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
            scenario, agent_ids, ROAD_USER_KINDS, keeps_beginnings=True
        ),
    )
    resolved = trajectories.with_yielding(last_ids, comfort_mps2)
    names = sorted(scenario.agents.ids[row] for row in resolved.changed)
    return resolved.scenario, tuple(names)


def retime_for_comfort(
    scenario: Scenario, agent_ids: Iterable[str] | None = None
) -> Scenario:
    """Slow lane followers with harsh motion along their own paths.

    Harsh is what the metrics ``uncomfortable`` and ``impossible`` count. Agents brake
    earlier and accelerate later than before, and never run ahead of their timing.
    Current poses stay; a current speed is lowered where the agent could not brake
    comfortably from it. Agents that collide with a slowed one yield if they are among
    ``agent_ids``; else the slowed one keeps its former trajectory, as do agents whose
    motion would still be harsh. ``agent_ids`` None means all.

    Raises:
        EditError: an id is not in the scenario.
    """
    before = Trajectories(
        scenario=scenario,
        may_change=repairable(scenario, agent_ids),
    )
    wanted = np.intersect1d(before.moving_rows(), harsh_rows(scenario))
    return _without_new_conflicts(before, _smoothed(before, wanted)).scenario


def harsh_rows(scenario: Scenario) -> Int[np.ndarray, "G"]:
    """Rows of agents whose motion exceeds a limit of comfort or of physics."""
    view = recorded_traffic(scenario)
    motion = kinematics(view)
    harsh = (motion.is_uncomfortable() | motion.is_impossible()) & motion.is_valid
    names = [view.agents.ids[row] for row in np.flatnonzero(harsh.any(axis=1))]
    return scenario.agents.rows(names)


def _smoothed(before: Trajectories, wanted: Int[np.ndarray, "G"]) -> Trajectories:
    """Slow agents as little as is enough."""
    done = before
    for share in SHARES:
        if not len(wanted):
            break
        tried = _slowed(before, wanted, share)
        is_left = np.isin(wanted, harsh_rows(tried.scenario))
        done = _with_rows_of(done, tried, wanted[~is_left])
        wanted = wanted[is_left]
    return done


def _slowed(
    trajectories: Trajectories, rows: Int[np.ndarray, "G"], share: float
) -> Trajectories:
    """Slow agents to a share of the limits; their paths stay."""
    agents, now = trajectories.agents, trajectories.scenario.current_step
    step_s = trajectories.scenario.time_axis.step_s
    is_valid = agents.is_valid[rows, now:]
    position, heading = agents.position_m[rows, now:], agents.heading_rad[rows, now:]
    first, _, _ = derivative_operators(is_valid.shape[1], WINDOW_STEPS, step_s)
    velocity = first @ fill_gaps(position, is_valid)
    fitted = np.hypot(velocity[..., 0], velocity[..., 1])
    unwrapped = fill_heading_gaps(heading, is_valid)
    yaw_rate = np.abs((first @ unwrapped[..., None])[..., 0])
    later, slowed_mps = slowed_to_limits(
        position,
        heading,
        is_valid,
        np.minimum(fitted, _turning_limit(fitted, yaw_rate, share)),
        step_s,
        braking_mps2=-share * COMFORT.braking_mps2,
        acceleration_mps2=share * COMFORT.acceleration_mps2,
    )
    later[0][:, 0], later[1][:, 0] = position[:, 0], heading[:, 0]
    own = agents.velocity_mps[rows, now]
    length = np.hypot(own[:, 0], own[:, 1])
    factor = np.minimum(slowed_mps[:, 0] / np.maximum(length, 1e-9), 1.0)
    later[2][:, 0] = factor[:, None] * own
    return trajectories.with_agents(agents.with_motion(rows, now, later), rows)


def _turning_limit(
    speed_mps: Float[np.ndarray, "G H"],
    yaw_rate_radps: Float[np.ndarray, "G H"],
    share: float,
) -> Float[np.ndarray, "G H"]:
    """Speed at which the path's curvature is comfortable; infinite where straight."""
    # Below this speed the curvature of a recorded path is noise.
    moves = speed_mps > 1.0
    curvature = np.where(moves, yaw_rate_radps / np.where(moves, speed_mps, 1.0), 0.0)
    bends = curvature > 1e-4
    curvature = np.where(bends, curvature, 1.0)
    sideways = np.sqrt(share * COMFORT.lateral_mps2 / curvature)
    turning = share * COMFORT.yaw_rate_radps / curvature
    return np.where(bends, np.minimum(sideways, turning), np.inf)


def _without_new_conflicts(before: Trajectories, after: Trajectories) -> Trajectories:
    """Let others yield to slowed agents, else restore the slowed ones of new conflicts."""
    known = {tuple(pair) for pair in before.conflicts().tolist()}
    slowed = after.changed

    def new_rows(trajectories: Trajectories) -> set[int]:
        pairs = trajectories.conflicts().tolist()
        return {row for pair in pairs if tuple(pair) not in known for row in pair}

    involved = new_rows(after)
    if not involved:
        return after
    partners: Bool[np.ndarray, "A"] = np.zeros(len(before.agents), bool)
    partners[list(involved - slowed)] = True
    yielding = replace(after, may_change=before.may_change & partners).with_yielding()
    if not new_rows(yielding):
        return yielding
    # Without those that still collide, those that yielded to them need not.
    kept = np.array(sorted(slowed - involved), int)
    return _with_rows_of(before, after, kept)


def _with_rows_of(
    one: Trajectories, other: Trajectories, rows: Int[np.ndarray, "G"]
) -> Trajectories:
    """The first trajectories with some agents' of the second."""
    if not len(rows):
        return one
    return one.with_agents(one.agents.with_motion_of(rows, other.agents, rows), rows)
