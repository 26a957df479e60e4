"""Noise levels of initial states: from the whole square down to decimetres."""

import math
from collections.abc import Sequence
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.diffusion.initial_state.state_encoding import (
    POSITION_UNIT_M,
    STATE_SPREAD,
)

POSITION_NOISE_M: Final = (0.1, 80.0)
"""Standard deviation of positions at level 0 and at level 1."""
DIRECTION_NOISE: Final = (0.04, 3.0)
"""Of headings (unit vectors) and of speed codes.

In between it is chosen so that the direction is known when the lane is: 0.4 at 3.5 m.
"""
_RANGES: Final = (
    *[tuple(noise / POSITION_UNIT_M for noise in POSITION_NOISE_M)] * 2,
    *[DIRECTION_NOISE] * 3,
)
_EMPHASIS: Final = 0.3
_LOWEST: Final = torch.tensor([math.log(low) for low, _ in _RANGES])
_SPAN: Final = torch.tensor([math.log(high / low) for low, high in _RANGES])
_SPREAD: Final = torch.tensor(STATE_SPREAD)


def noise_scale(level: Float[Tensor, "*b"]) -> Float[Tensor, "*b 5"]:
    """Standard deviation of the noise on each encoded part at levels in 0..1.

    Its logarithm is linear in the level: each step of the sampler resolves the next
    smaller scale. A negative level means no noise.
    """
    low, span = _LOWEST.to(level.device), _SPAN.to(level.device)
    scale = (low + span * level[..., None]).exp()
    return torch.where(level[..., None] < 0, 0.0, scale)


def preconditioning(
    scale: Float[Tensor, "*b 5"],
) -> tuple[Float[Tensor, "*b 5"], Float[Tensor, "*b 5"], Float[Tensor, "*b 5"]]:
    """Factors of the input, of the skipped input and of the network's output.

    So that input and target of the network are of unit size at each level.

    Source: Karras et al., Elucidating the design space of diffusion models, 2022.
    """
    spread = _SPREAD.to(scale.device)
    total = scale.square() + spread.square()
    return total.rsqrt(), spread.square() / total, scale * spread * total.rsqrt()


def first_noise(noise: Float[Tensor, "*b 5"]) -> Float[Tensor, "*b 5"]:
    """Noisy states at level 1 from unit noise; as wide as traffic with its noise."""
    scale = noise_scale(torch.ones((), device=noise.device))
    spread = _SPREAD.to(noise.device)
    return noise * (scale.square() + spread.square()).sqrt()


def sampling_levels(num_steps: int) -> Sequence[float]:
    """Levels of the steps from 1 down to 0, denser in the middle.

    10 steps so spread are as good as 12 even ones.
    """
    assert num_steps >= 1
    even = torch.linspace(1, 0, num_steps, dtype=torch.float64, device="cpu")
    # Rounded, so that the last one is 0.
    return [round(level, 12) for level in denser_levels(even).tolist()]


def denser_levels(even: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Levels 0..1, those in the middle nearly twice as dense as those at both ends.

    There lanes, headings and gaps are found.
    """
    return even + _EMPHASIS * (2 * math.pi * even).sin() / (2 * math.pi)
