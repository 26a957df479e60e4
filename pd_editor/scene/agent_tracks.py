"""Tracks of all agents of a scenario, as one struct of arrays."""

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.agent_states import MOTION, STEPPED, AgentStates
from pd_editor.scene.geometry.angles import turned, wrap_angle

_OVER_TIME = (*STEPPED, "observed")


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentTracks(AgentStates):
    """Tracks of A agents over T steps; zero where ``is_valid`` is false.

    Arrays are float64 and read-only. Positions are box centres in the scene frame.
    """

    categories: tuple[AgentCategory, ...]
    """Benchmark category of each agent."""
    has_known_size: Bool[np.ndarray, "A"]
    """False where the size is the default of the kind."""
    observed: Bool[np.ndarray, "A T"]
    """Argoverse 2's ``observed``: whether the step belongs to the given past."""
    activity: Int[np.ndarray, "A"] = field(default_factory=lambda: np.zeros(0, np.int8))
    """``Activity`` of each agent at the current step; empty if unknown for all."""
    has_made_up_past: Bool[np.ndarray, "A"] = field(
        default_factory=lambda: np.zeros(0, bool)
    )
    """Whether the states before the current step are made up; empty: of none."""

    def __post_init__(self) -> None:
        num_agents = len(self.ids)
        assert len(self.kinds) == len(self.categories) == num_agents
        assert len(set(self.ids)) == num_agents, "agent ids must be unique"
        for name, kind in (("activity", np.int8), ("has_made_up_past", bool)):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(num_agents, kind))
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, np.ndarray):
                assert len(value) == num_agents, one.name
                value.flags.writeable = False

    def with_rows(self, rows: np.ndarray, **arrays: np.ndarray) -> "AgentTracks":
        """A copy in which some arrays have new values at ``rows``."""
        changed: dict[str, Any] = {}
        for name, values in arrays.items():
            array = getattr(self, name).copy()
            array[rows] = values
            changed[name] = array
        return replace(self, **changed)

    def with_motion(
        self,
        rows: Int[np.ndarray, "G"],
        since: int,
        motion: tuple[np.ndarray, np.ndarray, np.ndarray],
        at: Bool[np.ndarray, "G S"] | None = None,
    ) -> "AgentTracks":
        """A copy in which some agents move otherwise at S steps from one on.

        Positions, headings and velocities of ``motion`` are taken where ``at`` is true,
        and the agents are there then; None: where they were there before.
        """
        steps = slice(since, since + motion[1].shape[1])
        there = self.is_valid[rows]
        at = there[:, steps] if at is None else at
        changed = {name: getattr(self, name)[rows] for name in MOTION}
        for values, new in zip(changed.values(), motion, strict=True):
            values[:, steps][at] = new[at]
        there[:, steps] |= at
        return self.with_rows(rows, **changed, is_valid=there)

    def carried(
        self,
        rows: Int[np.ndarray, "G"],
        step: int,
        target_m: Float[np.ndarray, "G 2"],
        turn_rad: Float[np.ndarray, "G"],
    ) -> "AgentTracks":
        """A copy in which whole tracks move rigidly to places at a step, and turn there."""
        position, is_valid = self.position_m[rows], self.is_valid[rows]
        current = position[:, step]
        changed: dict[str, np.ndarray] = {}
        if turn_rad.any():
            position = current[:, None] + turned(
                position - current[:, None], turn_rad[:, None]
            )
            heading = wrap_angle(self.heading_rad[rows] + turn_rad[:, None])
            velocity = turned(self.velocity_mps[rows], turn_rad[:, None])
            changed["heading_rad"] = np.where(is_valid, heading, 0.0)
            changed["velocity_mps"] = np.where(is_valid[..., None], velocity, 0.0)
        position = position + (target_m - current)[:, None]
        position[:, step] = target_m
        changed["position_m"] = np.where(is_valid[..., None], position, 0.0)
        return self.with_rows(rows, **changed)

    def with_motion_of(
        self, rows: Int[np.ndarray, "G"], other: AgentStates, theirs: np.ndarray
    ) -> "AgentTracks":
        """A copy in which some agents move as others, at all steps at which they are there."""
        return self.with_rows(
            rows, **{name: getattr(other, name)[theirs] for name in MOTION}
        )

    def cut_to(self, steps: slice) -> "AgentTracks":
        """The tracks at some steps."""
        return replace(
            self, **{name: getattr(self, name)[:, steps] for name in _OVER_TIME}
        )

    def without_future(
        self, step: int, num_steps: int, keeps: Bool[np.ndarray, "A"] | None = None
    ) -> "AgentTracks":
        """The tracks over ``num_steps`` steps, without states after ``step``.

        Those of the agents that are to be kept stay as far as they reach.
        """
        known = np.broadcast_to(np.arange(self.num_steps) <= step, self.is_valid.shape)
        if keeps is not None:
            known = known | keeps[:, None]
        shared = min(num_steps, self.num_steps)
        changed: dict[str, Any] = {}
        for name in _OVER_TIME:
            values = getattr(self, name)
            mask = known.reshape(*known.shape, *(1,) * (values.ndim - 2))
            table = np.zeros((len(self), num_steps, *values.shape[2:]), values.dtype)
            table[:, :shared] = (values * mask)[:, :shared]
            changed[name] = table
        return replace(self, **changed)


def same_motion(
    one: AgentTracks, other: AgentTracks, steps: slice = slice(None)
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Rows, in each of two sets, of the agents with identical motion in ``steps``."""
    known = [row for row, name in enumerate(one.ids) if name in other.row_of]
    rows = np.array(known, int)
    theirs = other.rows(one.ids[row] for row in known)
    same = np.ones(len(rows), bool)
    for name in STEPPED:
        mine = getattr(one, name)[rows][:, steps]
        others = getattr(other, name)[theirs][:, steps]
        if mine.shape != others.shape:
            # One of them was rolled out, so nobody moves as before.
            return rows[:0], theirs[:0]
        equal = mine == others
        same &= equal.all(axis=tuple(range(1, equal.ndim)))
    return rows[same], theirs[same]
