"""Tracks of all agents of a scenario, as one struct of arrays."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.errors import EditError
from pd_editor.scene.agent_kind import AgentCategory, AgentKind


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentTracks:
    """Tracks of A agents over T steps; zero where ``is_valid`` is false.

    Arrays are float64 and read-only. Positions are box centres in the scene frame.
    """

    ids: tuple[str, ...]
    """Track ids, unique."""
    kinds: tuple[AgentKind, ...]
    """Kind of each agent."""
    categories: tuple[AgentCategory, ...]
    """Benchmark category of each agent."""
    size_m: Float[np.ndarray, "A 2"]
    """Length and width."""
    has_known_size: Bool[np.ndarray, "A"]
    """False where the size is the default of the kind."""
    position_m: Float[np.ndarray, "A T 2"]
    heading_rad: Float[np.ndarray, "A T"]
    velocity_mps: Float[np.ndarray, "A T 2"]
    is_valid: Bool[np.ndarray, "A T"]
    """Whether the agent exists at a step."""
    observed: Bool[np.ndarray, "A T"]
    """Argoverse 2's ``observed``: whether the step belongs to the given past."""
    activity: Int[np.ndarray, "A"] = field(default_factory=lambda: np.zeros(0, np.int8))
    """``Activity`` of each agent at the current step; empty if unknown for all."""

    def __post_init__(self) -> None:
        num_agents = len(self.ids)
        assert len(self.kinds) == len(self.categories) == num_agents
        assert len(set(self.ids)) == num_agents, "agent ids must be unique"
        if not len(self.activity):
            object.__setattr__(self, "activity", np.zeros(num_agents, np.int8))
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, np.ndarray):
                assert len(value) == num_agents, one.name
                value.flags.writeable = False

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def num_steps(self) -> int:
        """Number of time steps T."""
        return self.is_valid.shape[1]

    @cached_property
    def row_of(self) -> dict[str, int]:
        """Row of each agent id."""
        return {agent_id: row for row, agent_id in enumerate(self.ids)}

    def rows(self, agent_ids: Iterable[str]) -> np.ndarray:
        """Rows of agents, in the order of ``agent_ids``.

        Raises:
            EditError: an id is not in the scenario.
        """
        try:
            return np.array([self.row_of[agent_id] for agent_id in agent_ids], int)
        except KeyError as error:
            raise EditError(f"There is no agent {error.args[0]!r} here.") from error

    def speed_mps(self) -> Float[np.ndarray, "A T"]:
        """Speed of each agent at each step."""
        return np.hypot(self.velocity_mps[..., 0], self.velocity_mps[..., 1])

    def kind_mask(self, kinds: Iterable[AgentKind]) -> Bool[np.ndarray, "A"]:
        """Whether each agent is of one of the kinds."""
        wanted = set(kinds)
        return np.array([kind in wanted for kind in self.kinds], bool)

    def taken(self, rows: Sequence[int] | np.ndarray) -> "AgentTracks":
        """Select the agents at ``rows``, in that order."""
        index = np.asarray(rows, int)
        values: dict[str, Any] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            values[one.name] = (
                value[index]
                if isinstance(value, np.ndarray)
                else tuple(value[row] for row in index)
            )
        return AgentTracks(**values)

    def joined(self, other: "AgentTracks") -> "AgentTracks":
        """Concatenate: these agents, then the other ones."""
        values: dict[str, Any] = {}
        for one in fields(self):
            mine, theirs = getattr(self, one.name), getattr(other, one.name)
            values[one.name] = (
                np.concatenate([mine, theirs])
                if isinstance(mine, np.ndarray)
                else mine + theirs
            )
        return AgentTracks(**values)

    def with_rows(self, rows: np.ndarray, **arrays: np.ndarray) -> "AgentTracks":
        """A copy in which some arrays have new values at ``rows``."""
        changed: dict[str, Any] = {}
        for name, values in arrays.items():
            array = getattr(self, name).copy()
            array[rows] = values
            changed[name] = array
        return replace(self, **changed)


def same_motion(
    one: AgentTracks, other: AgentTracks, steps: slice = slice(None)
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Rows, in each of two sets, of the agents with identical motion in ``steps``."""
    known = [row for row, name in enumerate(one.ids) if name in other.row_of]
    rows = np.array(known, int)
    theirs = other.rows(one.ids[row] for row in known)
    same = np.ones(len(rows), bool)
    for name in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
        mine = getattr(one, name)[rows][:, steps]
        equal = mine == getattr(other, name)[theirs][:, steps]
        same &= equal.all(axis=tuple(range(1, equal.ndim)))
    return rows[same], theirs[same]


def empty_tracks(num_steps: int) -> AgentTracks:
    """Tracks without agents."""
    return AgentTracks(
        ids=(),
        kinds=(),
        categories=(),
        size_m=np.zeros((0, 2)),
        has_known_size=np.zeros(0, bool),
        position_m=np.zeros((0, num_steps, 2)),
        heading_rad=np.zeros((0, num_steps)),
        velocity_mps=np.zeros((0, num_steps, 2)),
        is_valid=np.zeros((0, num_steps), bool),
        observed=np.zeros((0, num_steps), bool),
    )
