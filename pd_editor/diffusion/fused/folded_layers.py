"""What folded networks are made of: layers and waves, as they are computed fastest."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import layer_norm

Linear = tuple[Tensor, Tensor]
"""Weight and bias."""


class Affine:
    """A linear layer, its weights as they are multiplied fastest."""

    def __init__(self, layer: Linear, like: Tensor) -> None:
        """Weights are copied, onto the device of ``like`` and in its precision."""
        weight, bias = layer
        self._weight = weight.t().to(
            like, copy=True, memory_format=torch.contiguous_format
        )
        self._bias = bias.to(like, copy=True)

    def __call__(self, values: Float[Tensor, "Z I"]) -> Float[Tensor, "Z O"]:
        """The layer's output."""
        return torch.addmm(self._bias, values, self._weight)


class Norm:
    """A layer norm; with its weights it is faster than without, oddly."""

    def __init__(self, norm: nn.Module) -> None:
        """Weights are copied."""
        assert isinstance(norm, nn.LayerNorm)
        self._weight, self._bias = norm.weight.clone(), norm.bias.clone()
        self._shape, self._epsilon = norm.normalized_shape, norm.eps

    def __call__(self, values: Float[Tensor, "Z I"]) -> Float[Tensor, "Z I"]:
        """Each row at mean 0 and variance 1, then with the weights."""
        return layer_norm(values, self._shape, self._weight, self._bias, self._epsilon)


class PlaneWaves:
    """Waves along both axes: all sines, then all cosines, each pair x before y.

    A cosine is a sine a quarter turn ahead, so that one call computes all.
    """

    def __init__(self, wavelengths: Sequence[float], like: Tensor) -> None:
        """Made on the device of ``like`` and in its precision."""
        rates = like.new_tensor([2 * math.pi / one for one in wavelengths])
        num_sines = 2 * len(wavelengths)
        self.number = 2 * num_sines
        self.rate = rates.repeat_interleave(2).repeat(2)
        """Radians for each metre."""
        self.axis = torch.arange(self.number, device=like.device) % 2
        """0 for waves along x, 1 along y."""
        self.shift = like.new_zeros(self.number)
        """Added to the angles."""
        self.shift[num_sines:] = math.pi / 2

    @property
    def order(self) -> list[int]:
        """Places of the waves where each sine stands before its own cosine."""
        return [*range(0, self.number, 2), *range(1, self.number, 2)]

    def __call__(self, points_m: Float[Tensor, "Z 2"]) -> Float[Tensor, "Z W"]:
        """The waves at some points."""
        return scaled_columns(points_m, self.axis, self.rate, self.shift).sin_()

    def fading(self, noise: Float[Tensor, "*b"]) -> Float[Tensor, "*b W"]:
        """What is expected of each wave if its place has noise: exp(-(k s)^2 / 2)."""
        return (noise[..., None] * self.rate).square().mul(-0.5).exp()


def scaled_columns(
    values: Float[Tensor, "Z I"],
    column: Int[Tensor, "O"],
    factor: Float[Tensor, "O"],
    shift: Float[Tensor, "O"],
) -> Float[Tensor, "Z O"]:
    """Some columns, each with a factor and a shift.

    Unlike a matrix product it is exact whatever a user lets torch do with those: angles
    of hundreds of radians must not be rounded to TF32.
    """
    return torch.addcmul(shift, values.index_select(1, column), factor)


def linear_layers(module: nn.Module) -> list[nn.Linear]:
    """The linear layers of a chain, in its order."""
    return [layer for layer in module.children() if isinstance(layer, nn.Linear)]
