"""How noisy poses lie to each other and to the road, in few operations.

The features are those of ``pose_features`` in another order; ``layer`` has the factors
of those that are dampened.
"""

from typing import Final, NamedTuple

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from pd_editor.diffusion.fused.folded_layers import PlaneWaves, scaled_columns
from pd_editor.diffusion.initial_state.features import (
    LEAST_NOISE_M,
    LEAST_TURN_NOISE,
    NEIGHBOR_WAVELENGTHS_M,
)

_NUM_WAVES: Final = 4 * len(NEIGHBOR_WAVELENGTHS_M)
"""Sines and cosines, of both coordinates."""
_NUM_DAMPENED: Final = 5
_DISTANCE: Final = _NUM_WAVES + _NUM_DAMPENED
"""Where distance and direction are in ``pose_features``."""
_NUM_OF_MIDDLE: Final = 4


class NoiseFactors(NamedTuple):
    """What the noise makes of features."""

    fading: Float[Tensor, "*b 28"]
    """Of sines and cosines."""
    closeness: Float[Tensor, "*b D"]
    """Of what is dampened: 1, or one over the noise."""


class FoldedRelations:
    """Features of offsets and directions, complex numbers in one's own frame.

    With ``sees_middle`` a third number is the offset in another frame.
    """

    def __init__(self, like: Tensor, *, sees_middle: bool) -> None:
        """Made on the device of ``like`` and in its precision."""
        self._sees_middle = sees_middle
        self._waves = PlaneWaves(NEIGHBOR_WAVELENGTHS_M, like)
        # Real and imaginary part of offset and direction, then of the third number.
        taken = [0, 1, 0, 1, 3, *([4, 5, 4, 5] if sees_middle else [])]
        waves, as_it_is = self._waves, like.new_ones(len(taken))
        self._columns = (
            torch.cat([waves.axis, torch.tensor(taken, device=like.device)]),
            torch.cat([waves.rate, as_it_is]),
            torch.cat([waves.shift, torch.zeros_like(as_it_is)]),
        )

    @property
    def order(self) -> list[int]:
        """Places of the features among those of ``pose_features``."""
        of_middle = range(
            _DISTANCE + 3, _DISTANCE + 3 + _NUM_OF_MIDDLE * self._sees_middle
        )
        return [
            *self._waves.order,
            *range(_NUM_WAVES, _DISTANCE),
            *of_middle,
            *range(_DISTANCE, _DISTANCE + 3),
        ]

    def layer(self, weight: Float[Tensor, "R F"]) -> Float[Tensor, "F R"]:
        """Weights for the features as they come here, from those of a linear layer."""
        factor = weight.new_ones(len(self.order))
        factor[_NUM_WAVES:-2] = 1 / 3
        return (weight[:, self.order] * factor).t().contiguous()

    def noise_factors(
        self, noise_m: Float[Tensor, "*b"], turn_noise: Float[Tensor, "*b"]
    ) -> NoiseFactors:
        """What the standard deviations of places and directions make of features."""
        one = torch.ones_like(noise_m)
        near = 1 / (noise_m + LEAST_NOISE_M)
        parts = [one, one, near, near, 1 / (turn_noise + LEAST_TURN_NOISE)]
        if self._sees_middle:
            parts += [one, one, near, near]
        return NoiseFactors(self._waves.fading(noise_m), torch.stack(parts, dim=-1))

    def __call__(
        self, parts: list[Complex[Tensor, "*b"]], factors: NoiseFactors
    ) -> Float[Tensor, "N F"]:
        """Features of offsets, directions, and with ``sees_middle`` a third offset."""
        offset, direction = parts[:2]
        shape = offset.shape
        given = torch.view_as_real(torch.stack(parts, dim=-1)).flatten(-2)
        found = scaled_columns(given.flatten(0, -2), *self._columns).view(*shape, -1)
        return torch.cat(
            [
                found[..., :_NUM_WAVES].sin() * factors.fading,
                (found[..., _NUM_WAVES:] * factors.closeness).asinh_(),
                offset.abs().log1p_()[..., None],
                torch.view_as_real(direction),
            ],
            dim=-1,
        ).flatten(0, -2)
