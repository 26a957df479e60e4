"""Limits of what guidance asks of agents, and of what counts as obeyed."""

from dataclasses import dataclass
from typing import Final

MAX_BRAKING_MPS2: Final = 5.0
LIMIT_BRAKING_MPS2: Final = 2.0
"""Braking from a current speed above a limit down to it."""
MAX_SPEED_MPS: Final = 40.0

OPENING_MPS: Final = 1.5
"""Rate at which a gap opens that is shorter than asked for now."""


@dataclass(frozen=True, kw_only=True)
class ObeyedWithin:
    """Deviations from what is asked up to which a term is obeyed."""

    goal_m: float = 1.0
    path_m: float = 0.5
    speed_mps: float = 0.5
    overrun_m: float = 0.5
    acceleration_mps2: float = 0.5
    outside_m: float = 0.3
    """Distance of a box's corner outside the road."""
    gap_m: float = 0.5


OBEYED: Final = ObeyedWithin()
