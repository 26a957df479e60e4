"""Default settings, in a module without torch so that menus can show them."""

from typing import Final, Literal

DeviceName = Literal["auto", "cpu", "cuda"]
"""Device on which a model computes; auto uses a GPU if there is one."""

NUM_STEPS: Final = 5
"""Denoising steps of the trajectory stage."""
DEFAULT_WEIGHT: Final = 0.8
"""Default strength of the guidance to the nearest candidate."""
DEFAULT_WARPED_WEIGHT: Final = 1.0
"""Default strength on warped roads."""
MAX_CONFIG_BYTES: Final = 2**20
MAX_FILE_BYTES: Final = 512 * 2**20
"""Largest file of weights that is read."""
NUM_TRIES: Final = 1
"""Trajectories sampled per agent, from which the least colliding ones are selected."""
