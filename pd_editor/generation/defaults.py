"""Default settings and limits, in a module without torch so that menus can show them."""

import math
from dataclasses import fields
from typing import TYPE_CHECKING, Final, Literal

from pd_editor.base.errors import ModelError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

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


MAX_WIDTH: Final = 1024
MAX_NUMBER: Final = 128
"""Largest number of layers, blocks, heads or neighbours."""


def check_sizes(config: "DataclassInstance") -> None:
    """Raise for integers in a configuration that are invalid, or too large.

    Fields whose names end in ``width`` are widths, all others are counts;
    ``width`` must be a multiple of ``num_heads``.

    Raises:
        ModelError: a field is out of range.
    """
    sizes = {
        one.name: value
        for one in fields(config)
        if type(value := getattr(config, one.name)) is int
    }
    for name, value in sizes.items():
        limit = MAX_WIDTH if name.endswith("width") else MAX_NUMBER
        if not 1 <= value <= limit:
            raise ModelError(
                f"{name} is {value:g}; expected a whole number from 1 to {limit}."
            )
    width, heads = sizes.get("width", 1), sizes.get("num_heads", 1)
    if width % heads:
        raise ModelError(
            f"width is {width} and num_heads is {heads}; expected a width that is a "
            "multiple of the number of heads."
        )


def check_settings(config: "DataclassInstance") -> None:
    """Raise for invalid settings of a sampler or of its guidance.

    Integers are counts, at least 1; all other numbers are finite and not negative.

    Raises:
        ModelError: a field is out of range.
    """
    for one in fields(config):
        value = getattr(config, one.name)
        least = 1 if type(value) is int else 0
        if type(value) in (int, float) and not least <= value < math.inf:
            raise ModelError(
                f"{one.name} is {value:g}; expected a finite number from {least} on."
            )
