"""Kinds of agents and what is assumed of them."""

from enum import IntEnum, StrEnum
from typing import Final

import numpy as np
from jaxtyping import Float


class AgentKind(StrEnum):
    """What an agent is; the values are those of Argoverse 2's ``object_type``."""

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
"""Kinds that move by their own will."""

MOVER_KINDS: Final = frozenset(
    {AgentKind.VEHICLE, AgentKind.BUS, AgentKind.MOTORCYCLIST}
)
"""Kinds that drive on vehicle lanes; the movers of all tables."""

LANE_FOLLOWER_KINDS: Final = MOVER_KINDS | {AgentKind.CYCLIST}
"""Kinds that follow lanes."""

DEFAULT_SIZE_M: Final[dict[AgentKind, tuple[float, float]]] = {
    AgentKind.VEHICLE: (4.6, 1.9),
    AgentKind.BUS: (12.0, 2.9),
    AgentKind.MOTORCYCLIST: (2.1, 0.8),
    AgentKind.CYCLIST: (1.8, 0.7),
    AgentKind.PEDESTRIAN: (0.7, 0.7),
    AgentKind.STATIC: (0.9, 0.9),
    AgentKind.BACKGROUND: (1.0, 1.0),
    AgentKind.CONSTRUCTION: (0.7, 0.7),
    AgentKind.RIDERLESS_BICYCLE: (1.7, 0.6),
    AgentKind.UNKNOWN: (1.0, 1.0),
}
"""Length and width assumed where a file carries none (Argoverse 2 tracks do not)."""

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
"""Height drawn for each kind; scenes themselves are flat."""


def default_sizes_m(kinds: tuple[AgentKind, ...]) -> Float[np.ndarray, "A 2"]:
    """Default length and width of each agent."""
    return np.array([DEFAULT_SIZE_M[kind] for kind in kinds], float).reshape(-1, 2)
