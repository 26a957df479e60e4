"""Limits of what guidance asks of agents, and of what counts as obeyed."""

from typing import Final

MAX_BRAKING_MPS2: Final = 5.0
LIMIT_BRAKING_MPS2: Final = 2.0
"""Braking from a current speed above a limit down to it."""
MAX_SPEED_MPS: Final = 40.0

OBEYED_GOAL_M: Final = 1.0
OBEYED_PATH_M: Final = 0.5
OBEYED_SPEED_MPS: Final = 0.5
OBEYED_OVERRUN_M: Final = 0.5
OBEYED_ACCELERATION_MPS2: Final = 0.5
OBEYED_OUTSIDE_M: Final = 0.3
"""Distance of a box's corner outside the road."""
OBEYED_GAP_M: Final = 0.5
OPENING_MPS: Final = 1.5
"""Rate at which a gap opens that is shorter than asked for now."""
