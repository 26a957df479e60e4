"""States of agents over time, as one struct of arrays."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.scene.agent_kind import GROUP_KINDS, AgentGroup, AgentKind
from pd_editor.scene.geometry.oriented_box import BoxStates

MOTION: Final = ("position_m", "heading_rad", "velocity_mps")
"""Names of the arrays that tell how agents move."""
STEPPED: Final = (*MOTION, "is_valid")
"""Names of the arrays over time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentStates(BoxStates):
    """A agents at T steps; zero where ``is_valid`` is false."""

    ids: tuple[str, ...]
    """Ids, unique."""
    kinds: tuple[AgentKind, ...]
    velocity_mps: Float[np.ndarray, "A T 2"]

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def row_of(self) -> dict[str, int]:
        """Row of each agent id."""
        return {agent_id: row for row, agent_id in enumerate(self.ids)}

    def rows(self, agent_ids: Iterable[str]) -> np.ndarray:
        """Rows of agents, in the order of ``agent_ids``.

        Raises:
            EditError: an id is not among them.
        """
        try:
            return np.array([self.row_of[agent_id] for agent_id in agent_ids], int)
        except KeyError as error:
            name = error.args[0]
            near = nearest_or_all(str(name), self.ids)
            raise EditError(f"There is no agent {name!r} here; {near}.") from error

    def speed_mps(self) -> Float[np.ndarray, "A T"]:
        """Speed of each agent at each step."""
        return np.hypot(self.velocity_mps[..., 0], self.velocity_mps[..., 1])

    def kind_mask(self, kinds: Iterable[AgentKind]) -> Bool[np.ndarray, "A"]:
        """Whether each agent is of one of the kinds."""
        wanted = set(kinds)
        return np.array([kind in wanted for kind in self.kinds], bool)

    @cached_property
    def group(self) -> Int[np.ndarray, "A"]:
        """Index into ``GROUP_KINDS`` of each agent; -1 for static objects."""
        index = {
            kind: row
            for row, kinds in enumerate(GROUP_KINDS.values())
            for kind in kinds
        }
        return np.array([index.get(kind, -1) for kind in self.kinds], int)

    def is_in(self, group: AgentGroup) -> Bool[np.ndarray, "A"]:
        """Whether each agent belongs to a group."""
        return self.kind_mask(GROUP_KINDS[group])

    def from_step(self, step: int) -> "AgentStates":
        """The states from a step on."""
        return AgentStates(
            ids=self.ids,
            kinds=self.kinds,
            size_m=self.size_m,
            **{name: getattr(self, name)[:, step:] for name in STEPPED},
        )
