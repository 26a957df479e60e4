"""What is used unless a user says otherwise; here without torch, for menus to show."""

from typing import Final, Literal

DeviceName = Literal["auto", "cpu", "cuda"]
"""Where a model computes; auto takes a GPU if there is one."""

NUM_STEPS: Final = 5
"""Denoising steps of the trajectory stage."""
DEFAULT_WEIGHT: Final = 0.8
"""Strength of the pull to the nearest candidate."""
DEFAULT_WARPED_WEIGHT: Final = 1.0
"""The same where the road is warped."""
NUM_TRIES: Final = 1
"""Trajectories of each agent of which those that avoid others are taken."""
