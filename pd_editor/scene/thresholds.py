"""Thresholds that the whole project shares."""

from typing import Final

STANDING_MPS: Final = 0.3
"""Slower than this, an agent stands: the noise of tracked speeds is below it."""
MOVING_MPS: Final = 0.5
"""From this speed on an agent is under way: it drives, and its velocity tells where to."""
FIRM_ACCELERATION_MPS2: Final = 2.5
"""Most that candidates, agents after a curve and guided ones accelerate."""
