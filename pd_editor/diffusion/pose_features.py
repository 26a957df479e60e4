"""How noisy poses lie to each other and to the road, at all scales at once."""

import functools
import math
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

PLACE_WAVELENGTHS_M: Final = (16.0, 32.0, 64.0, 128.0, 256.0)
"""Scales at which a place in the square is told."""
NEIGHBOR_WAVELENGTHS_M: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
NUM_PLACE_FEATURES: Final = 4 * len(PLACE_WAVELENGTHS_M)
NUM_OFFSET_FEATURES: Final = 4 * len(NEIGHBOR_WAVELENGTHS_M) + 5
"""Waves of both coordinates; both at the scale of a metre and of the noise; distance."""
NUM_AGENT_FEATURES: Final = NUM_OFFSET_FEATURES + 2
NUM_PIECE_FEATURES: Final = NUM_OFFSET_FEATURES + 6


def waves(
    points_m: Float[Tensor, "*b 2"],
    wavelengths_m: tuple[float, ...],
    noise_m: Float[Tensor, "*b"] | None = None,
) -> Float[Tensor, "*b F"]:
    """Sines and cosines of both coordinates at some wavelengths.

    With the standard deviation of the points they are what is expected of the clean
    points: waves shorter than the noise fade out.

    Source: Barron et al., Mip-NeRF, 2021 (integrated positional encoding).
    """
    rates = _rates(wavelengths_m, points_m.device)
    phase = points_m[..., None, :] * rates[:, None]
    found = torch.stack([phase.sin(), phase.cos()], dim=-1)
    if noise_m is not None:
        fading = (noise_m[..., None] * rates).square().mul(-0.5).exp()
        found = found * fading[..., None, None]
    return found.flatten(-3)


@functools.lru_cache
def _rates(wavelengths_m: tuple[float, ...], device: torch.device) -> Tensor:
    """Radians for each metre; made once, outside of what is differentiated."""
    with torch.inference_mode(mode=False):
        return torch.tensor([2 * math.pi / one for one in wavelengths_m], device=device)


def offset_features(
    offset_m: Float[Tensor, "*b 2"], noise_m: Float[Tensor, "*b"]
) -> Float[Tensor, "*b F"]:
    """An offset in the frame of whom it starts from, known up to some noise."""
    distance = offset_m.norm(dim=-1, keepdim=True)
    return torch.cat(
        [
            waves(offset_m, NEIGHBOR_WAVELENGTHS_M, noise_m),
            plain_offset(offset_m, noise_m),
            distance.log1p() / 3,
        ],
        dim=-1,
    )


def plain_offset(
    offset_m: Float[Tensor, "*b 2"], noise_m: Float[Tensor, "*b"]
) -> Float[Tensor, "*b 4"]:
    """An offset at the scale of a metre and at that of the noise, far ones dampened."""
    scaled = offset_m / (noise_m[..., None] + 0.05)
    return torch.cat([offset_m, scaled], dim=-1).asinh() / 3


def turned_back(
    vectors: Float[Tensor, "*b 2"], direction: Float[Tensor, "*b 2"]
) -> Float[Tensor, "*b 2"]:
    """Vectors in frames whose x axis is a unit direction."""
    x, y = vectors.unbind(-1)
    cos, sin = direction.unbind(-1)
    return torch.stack([cos * x + sin * y, cos * y - sin * x], dim=-1)


def turned(
    vectors: Float[Tensor, "*b 2"], direction: Float[Tensor, "*b 2"]
) -> Float[Tensor, "*b 2"]:
    """Inverse of ``turned_back``."""
    x, y = vectors.unbind(-1)
    cos, sin = direction.unbind(-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y], dim=-1)


def agent_relations(
    position_m: Float[Tensor, "N A 2"],
    direction: Float[Tensor, "N A 2"],
    noise_m: Float[Tensor, "N A"],
) -> Float[Tensor, "N A A F"]:
    """How each agent sees every other one: offset and direction in its own frame."""
    offset = position_m[:, None] - position_m[:, :, None]
    own = direction[:, :, None].expand_as(offset)
    other = direction[:, None].expand_as(offset)
    both_m = (noise_m[:, None].square() + noise_m[:, :, None].square()).sqrt()
    return torch.cat(
        [offset_features(turned_back(offset, own), both_m), turned_back(other, own)],
        dim=-1,
    )


def piece_relations(
    position_m: Float[Tensor, "N A 2"],
    direction: Float[Tensor, "N A 2"],
    noise_m: Float[Tensor, "N A"],
    piece: Float[Tensor, "N A M 4"],
) -> Float[Tensor, "N A M F"]:
    """How each agent lies to its pieces: offset and direction in the piece's frame.

    And which way the piece's middle is in the agent's own frame. Pieces are told by x,
    y, cosine and sine.
    """
    middle, axis = piece.split(2, dim=-1)
    offset = position_m[:, :, None] - middle
    own = direction[:, :, None].expand_as(offset)
    noise = noise_m[:, :, None].expand(offset.shape[:-1])
    return torch.cat(
        [
            offset_features(turned_back(offset, axis), noise),
            turned_back(own, axis),
            plain_offset(turned_back(-offset, own), noise),
        ],
        dim=-1,
    )


def nearest_pieces(
    position_m: Float[Tensor, "B Q 2"],
    prefers_crossings: Bool[Tensor, "B Q"],
    piece_m: Float[Tensor, "B P 2"],
    is_crossing: Bool[Tensor, "B P"],
    has_piece: Bool[Tensor, "B P"],
    num_nearest: int,
) -> Int[Tensor, "B Q M"]:
    """The pieces nearest to each position, missing ones last.

    To a pedestrian crosswalks seem at half the distance, to others at twice.
    """
    distance = torch.cdist(position_m, piece_m)
    factor = torch.where(prefers_crossings, 0.5, 2.0)[..., None]
    distance = torch.where(is_crossing[:, None], distance * factor, distance)
    distance = distance.masked_fill(~has_piece[:, None], math.inf)
    num_nearest = min(num_nearest, distance.shape[-1])
    return distance.topk(num_nearest, dim=-1, largest=False).indices
