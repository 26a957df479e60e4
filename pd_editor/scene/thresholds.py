"""Thresholds that the whole project shares."""

import math
from typing import Final

STANDING_MPS: Final = 0.3
"""Slower than this, an agent stands: the noise of tracked speeds is below it."""
MOVING_MPS: Final = 0.5
"""From this speed on an agent is under way: it drives, and its velocity tells where to."""
FASTEST_MPS: Final = 60.0
"""Nobody drives faster: edits and guidance ask for no more, and recordings of more are told."""
MOVED_M: Final = 1.0
"""Who stays nearer to where it was has not moved: recorded places jitter by less."""
STATIONARY_M: Final = 0.5
"""Who stays within this distance of its first place is stationary."""
SAME_STATE_M: Final = 0.01
"""A generated place this close to the present one counts as the same."""
FIRM_ACCELERATION_MPS2: Final = 2.5
"""Most that candidates, agents after a curve and guided ones accelerate."""
PARKED_OFFSET_M: Final = 1.2
PARKED_TURN_RAD: Final = math.radians(30)
"""Stationary agents further from their lane, or at a larger angle, are parked."""
