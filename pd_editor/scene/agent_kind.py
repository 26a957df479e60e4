"""Kinds and benchmark categories of agents, and default sizes."""

from enum import IntEnum, StrEnum
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.thresholds import MOVING_MPS


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

    @property
    def label(self) -> str:
        """Name in legends: kinds of one colour have one."""
        others = (AgentKind.STATIC, AgentKind.BACKGROUND, AgentKind.UNKNOWN)
        return "Other object" if self in others else self.in_words.capitalize()


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

_SIZE_SHARES: Final = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)
_SIZES_M: Final[dict[AgentKind, tuple[tuple[float, ...], tuple[float, ...]]]] = {
    AgentKind.VEHICLE: (
        (4.06, 4.14, 4.33, 4.59, 5.01, 6.1, 10.23),
        (1.74, 1.74, 1.78, 1.9, 2.16, 2.34, 3.09),
    ),
    AgentKind.BUS: (
        (9.5, 10.5, 11.5, 12.0, 12.0, 12.2, 13.7),
        (2.5, 2.5, 2.5, 2.55, 2.9, 2.95, 3.0),
    ),
    AgentKind.MOTORCYCLIST: (
        (1.9, 2.0, 2.1, 2.2, 2.2, 2.3, 2.4),
        (0.7, 0.75, 0.8, 0.85, 0.9, 0.9, 0.95),
    ),
    AgentKind.CYCLIST: (
        (1.55, 1.6, 1.65, 1.7, 1.75, 1.8, 1.9),
        (0.5, 0.55, 0.6, 0.65, 0.65, 0.7, 0.75),
    ),
    AgentKind.PEDESTRIAN: (
        (0.6, 0.64, 0.67, 0.74, 0.9, 1.01, 1.18),
        (0.6, 0.6, 0.66, 0.78, 0.98, 1.24, 1.24),
    ),
}
"""Lengths and widths that these shares of agents do not exceed, trucks among vehicles.

Of vehicles and pedestrians the 2, 10, 25, 50, 75, 90 and 98 % quantiles of the tracks of
``DEFAULT_SIZE_M``; of the other kinds usual sizes about SUMO's and those few tracks.
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


def sampled_sizes_m(
    kinds: tuple[AgentKind, ...], random: np.random.Generator
) -> Float[np.ndarray, "A 2"]:
    """Length and width of agents, drawn as they are on roads; static objects': defaults.

    Long agents are wide ones. Values are whole centimetres.
    """
    sizes = default_sizes_m(kinds)
    for row, share in enumerate(random.random(len(kinds))):
        if (sides := _SIZES_M.get(kinds[row])) is not None:
            sizes[row] = [np.interp(share, _SIZE_SHARES, side) for side in sides]
    return sizes.round(2)


class Activity(IntEnum):
    """Categorical attribute of an agent; Argoverse 2 files do not contain it."""

    UNKNOWN = 0
    PARKED = 1
    """Stationary beside the traffic, without the intention to drive."""
    WAITING = 2
    """Stationary in traffic, for example at a light or in a queue."""
    DRIVING = 3
    """Moving."""

    @property
    def in_words(self) -> str:
        """As users read it; people do not drive."""
        words = {Activity.UNKNOWN: "not known", Activity.DRIVING: "moving"}
        return words.get(self, self.name.lower())


def stands(speed_mps: Float[np.ndarray, "*s"]) -> Bool[np.ndarray, "*s"]:
    """Whether agents of these speeds stand."""
    return speed_mps < MOVING_MPS


def activity_at(
    activity: Int[np.ndarray, "A"], speed_mps: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Make known activities consistent with speeds: moving agents are driving."""
    is_standing = stands(speed_mps)
    known = np.where(
        is_standing & (activity == Activity.DRIVING), Activity.WAITING, activity
    )
    return np.where(~is_standing & (known > 0), Activity.DRIVING, known)


def true_activity(
    is_parked: Bool[np.ndarray, "A"], speed_mps: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Activities of agents for which it is known whether they are parked."""
    standing = np.where(is_parked, Activity.PARKED, Activity.WAITING)
    return activity_at(standing, speed_mps)
