"""Values that outcomes of terms are made of."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import TrafficSample


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was asked and achieved, in words and as a deviation."""

    asked: str
    achieved: str
    error: float
    unit: str
    is_obeyed: bool
    is_feasible: bool = True
    """Whether it could have been met, against what the other agent did."""
    has_no_case: bool = False
    """Whether nothing arose to which the term applies, so that a term that was infeasible
    before the run is not obeyed."""
    worst_id: str | None = None
    """The agent that the deviation is of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """A sample on its scenario."""

    scenario: Scenario
    sample: TrafficSample

    @property
    def step_s(self) -> float:
        """Time between two steps."""
        return self.scenario.time_axis.step_s

    @property
    def num_steps(self) -> int:
        """Number of steps, the current one included."""
        return self.sample.heading_rad.shape[1]

    def row(self, agent_id: str) -> int | None:
        """Row of an agent in the sample; None if it was not generated."""
        ids = self.sample.ids
        return ids.index(agent_id) if agent_id in ids else None

    def rows(
        self, agent_ids: Collection[str], kinds: Collection[AgentKind]
    ) -> Int[np.ndarray, "G"]:
        """Rows of the generated agents among some; without names, those of some kinds."""
        pairs = zip(self.sample.ids, self.sample.kinds, strict=True)
        wanted = [
            name in agent_ids if agent_ids else kind in kinds for name, kind in pairs
        ]
        return np.flatnonzero(np.array(wanted, bool))

    def speed_mps(self) -> Float[np.ndarray, "G S"]:
        """Speeds of all agents."""
        return np.hypot(*np.moveaxis(self.sample.velocity_mps, -1, 0))


def of_several(count: int, words: str) -> str:
    """Words on the worst of several agents."""
    return words if count == 1 else f"{words} (the worst of {count} agents)"
