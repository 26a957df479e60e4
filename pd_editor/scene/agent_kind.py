"""Kinds and benchmark categories of agents, and default sizes."""

from enum import IntEnum, StrEnum
from typing import Final, Literal

import numpy as np
from jaxtyping import Float


class AgentKind(StrEnum):
    """Kind of an agent; values are those of Argoverse 2's ``object_type``."""

    VEHICLE = "vehicle"
    PEDESTRIAN = "pedestrian"
    MOTORCYCLIST = "motorcyclist"
    CYCLIST = "cyclist"
    BUS = "bus"
    STATIC = "static"
    BACKGROUND = "background"
    CONSTRUCTION = "construction"
    RIDERLESS_BICYCLE = "riderless_bicycle"
    UNKNOWN = "unknown"

    @property
    def in_words(self) -> str:
        """Name for sentences."""
        return self.value.replace("_", " ")


class AgentCategory(IntEnum):
    """How a benchmark uses a track; Argoverse 2's ``object_category``."""

    FRAGMENT = 0
    UNSCORED = 1
    SCORED = 2
    FOCAL = 3


ROAD_USER_KINDS: Final = frozenset(
    {
        AgentKind.VEHICLE,
        AgentKind.BUS,
        AgentKind.MOTORCYCLIST,
        AgentKind.CYCLIST,
        AgentKind.PEDESTRIAN,
    }
)
"""Kinds of road users; all others are static objects."""

MOTOR_VEHICLE_KINDS: Final = frozenset(
    {AgentKind.VEHICLE, AgentKind.BUS, AgentKind.MOTORCYCLIST}
)
"""Kinds of motor vehicles, moving or parked; result files call them ``movers``."""

LANE_FOLLOWER_KINDS: Final = MOTOR_VEHICLE_KINDS | {AgentKind.CYCLIST}
"""Kinds that follow lanes."""

AgentGroup = Literal["movers", "pedestrians", "cyclists"]
GROUP_KINDS: Final[dict[AgentGroup, frozenset[AgentKind]]] = {
    "movers": MOTOR_VEHICLE_KINDS,
    "pedestrians": frozenset({AgentKind.PEDESTRIAN}),
    "cyclists": frozenset({AgentKind.CYCLIST}),
}
"""Kinds of agents in each group, which is a row of all tables."""

DEFAULT_SIZE_M: Final[dict[AgentKind, tuple[float, float]]] = {
    AgentKind.VEHICLE: (4.6, 1.9),
    AgentKind.BUS: (12.0, 2.9),
    AgentKind.MOTORCYCLIST: (2.1, 0.8),
    AgentKind.CYCLIST: (1.8, 0.7),
    AgentKind.PEDESTRIAN: (0.7, 0.8),
    AgentKind.STATIC: (0.4, 0.3),
    AgentKind.BACKGROUND: (1.0, 1.0),
    AgentKind.CONSTRUCTION: (0.3, 0.4),
    AgentKind.RIDERLESS_BICYCLE: (1.6, 0.5),
    AgentKind.UNKNOWN: (1.0, 1.0),
}
"""Length and width assumed where a file carries none (Argoverse 2 tracks do not).

Medians of the measured boxes in Argoverse 2 sensor logs, rounded to 0.1 m: vehicles
161 tracks, pedestrians 45, static objects 59, construction 8, riderless bicycles 15
(``benchmarks/default_sizes.py``). Kinds with fewer than 5 tracks there (buses,
motorcyclists, cyclists, background, unknown) have a usual size instead.
"""

DEFAULT_HEIGHT_M: Final[dict[AgentKind, float]] = {
    AgentKind.VEHICLE: 1.6,
    AgentKind.BUS: 3.2,
    AgentKind.MOTORCYCLIST: 1.6,
    AgentKind.CYCLIST: 1.75,
    AgentKind.PEDESTRIAN: 1.75,
    AgentKind.STATIC: 1.0,
    AgentKind.BACKGROUND: 1.0,
    AgentKind.CONSTRUCTION: 0.9,
    AgentKind.RIDERLESS_BICYCLE: 1.1,
    AgentKind.UNKNOWN: 1.2,
}
"""Height with which each kind is rendered; scenes themselves are flat."""


def default_sizes_m(kinds: tuple[AgentKind, ...]) -> Float[np.ndarray, "A 2"]:
    """Default length and width of agents by kind."""
    return np.array([DEFAULT_SIZE_M[kind] for kind in kinds], float).reshape(-1, 2)
