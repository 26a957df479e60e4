"""Recordings of simulated traffic on a map over several minutes, and windows of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.signals import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Simulated tracks of A agents; P states of all agents, one agent after another.

    The frame is that of the road map. Positions are box centres, headings point
    where the vehicle points, velocities are rates of change of the positions.
    """

    name: str
    """Unique name in a dataset, such as ``roundabout-00017``."""
    road_map: RoadMap
    city: str
    """City name in scenario files; for procedural roads their family."""
    origin_city_m: Float[np.ndarray, "2"]
    """Origin of the recording's frame in city coordinates."""
    step_s: float
    num_steps: int
    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    size_m: Float[np.ndarray, "A 2"]
    """True length and width."""
    is_parked: Bool[np.ndarray, "A"]
    """Whether an agent is parked for the whole recording."""
    first_step: Int[np.ndarray, "A"]
    """Step of each agent's first row."""
    first_row: Int[np.ndarray, "A_plus_1"]
    """Agent a has the rows from ``first_row[a]`` to before ``first_row[a + 1]``."""
    position_m: Float[np.ndarray, "P 2"]
    heading_rad: Float[np.ndarray, "P"]
    velocity_mps: Float[np.ndarray, "P 2"]
    signals: tuple[Signal, ...] = ()
    """Traffic signals, with their states at all steps."""

    def __post_init__(self) -> None:
        count = len(self.ids)
        assert len(self.kinds) == len(self.size_m) == len(self.first_step) == count
        assert len(self.first_row) == count + 1
        assert self.first_row[-1] == len(self.position_m) == len(self.heading_rad)

    @cached_property
    def extent_m(self) -> Float[np.ndarray, "2 A 2"]:
        """Least and greatest coordinates of each agent."""
        if not self.ids:
            return np.zeros((2, 0, 2))
        starts = self.first_row[:-1]
        least = np.minimum.reduceat(self.position_m, starts, axis=0)
        return np.stack([least, np.maximum.reduceat(self.position_m, starts, axis=0)])


@dataclass(frozen=True, kw_only=True)
class Window:
    """Place and time of a clip in a recording."""

    current_step: int
    """Step of the recording that becomes the scenario's current one."""
    center_m: tuple[float, float]
    """Centre of the clip's square."""
    focal_id: str
    seed: int
    """Seed of all random choices when the clip is extracted."""
