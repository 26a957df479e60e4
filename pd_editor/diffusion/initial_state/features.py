"""How noisy poses lie to each other and to the road, at all scales at once."""

import functools
import math
from typing import Final, NamedTuple

import torch
from jaxtyping import Bool, Complex, Float, Int
from torch import Tensor

PLACE_WAVELENGTHS_M: Final = (16.0, 32.0, 64.0, 128.0, 256.0)
"""Scales at which a place in the square is told."""
NEIGHBOR_WAVELENGTHS_M: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
NUM_PLACE_FEATURES: Final = 4 * len(PLACE_WAVELENGTHS_M)
NUM_AGENT_FEATURES: Final = 4 * len(NEIGHBOR_WAVELENGTHS_M) + 8
"""Waves of both coordinates; both at the scale of a metre and of the noise; distance;
direction, and its sine at the scale of the noise."""
NUM_PIECE_FEATURES: Final = NUM_AGENT_FEATURES + 4

LEAST_NOISE_M: Final = 0.05
LEAST_TURN_NOISE: Final = 0.02
"""Added where something is told at the scale of the noise: given agents have none."""


class NoisyPoses(NamedTuple):
    """Poses that are known up to some noise, given by its standard deviations."""

    position_m: Float[Tensor, "*b 2"]
    direction: Float[Tensor, "*b 2"]
    """Of unit length."""
    noise_m: Float[Tensor, "*b"]
    turn_noise: Float[Tensor, "*b"]
    """In radians, while small."""

    def flattened(self, first: int, last: int) -> "NoisyPoses":
        """With some dimensions made one."""
        return NoisyPoses(*(one.flatten(first, last) for one in self))


def waves(
    points_m: Float[Tensor, "*b 2"],
    wavelengths_m: tuple[float, ...],
    noise_m: Float[Tensor, "*#b"] | None = None,
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


def relation_features(
    offset_m: Float[Tensor, "*b 2"],
    direction: Float[Tensor, "*b 2"],
    noise_m: Float[Tensor, "*#b"],
    turn_noise: Float[Tensor, "*#b"],
) -> Float[Tensor, "*b F"]:
    """An offset and a direction in one's own frame, both known up to some noise.

    Far offsets are dampened.
    """
    noise = torch.stack([noise_m, noise_m, turn_noise], dim=-1)
    lies = torch.cat([offset_m, direction[..., 1:]], dim=-1)
    least = (LEAST_NOISE_M, LEAST_NOISE_M, LEAST_TURN_NOISE)
    scaled = lies / (noise + noise.new_tensor(least))
    return torch.cat(
        [
            waves(offset_m, NEIGHBOR_WAVELENGTHS_M, noise_m),
            torch.cat([offset_m, scaled], dim=-1).asinh() / 3,
            offset_m.norm(dim=-1, keepdim=True).log1p() / 3,
            direction,
        ],
        dim=-1,
    )


def turned_back(
    vectors: Float[Tensor, "*#b 2"], direction: Float[Tensor, "*#b 2"]
) -> Float[Tensor, "*b 2"]:
    """Vectors in frames whose x axis is a unit direction."""
    return torch.view_as_real(
        as_complex(vectors) * as_complex(direction).conj_physical()
    )


def turned(
    vectors: Float[Tensor, "*#b 2"], direction: Float[Tensor, "*#b 2"]
) -> Float[Tensor, "*b 2"]:
    """Inverse of ``turned_back``."""
    return torch.view_as_real(as_complex(vectors) * as_complex(direction))


def as_complex(vectors: Float[Tensor, "*b 2"]) -> Complex[Tensor, "*b"]:
    """As complex numbers, of which turning takes one operation."""
    vectors = vectors.contiguous()
    # A part of a row counts as contiguous where there is only one row.
    is_even = vectors.storage_offset() % 2 == 0
    return torch.view_as_complex(vectors if is_even else vectors.clone())


def agent_relations(poses: NoisyPoses) -> Float[Tensor, "N A A F"]:
    """How each of A agents sees every other one: offset and direction in its frame."""

    def of_both(noise: Float[Tensor, "N A"]) -> Float[Tensor, "N A A"]:
        return (noise[:, None].square() + noise[:, :, None].square()).sqrt()

    position_m, own = poses.position_m, poses.direction[:, :, None]
    return relation_features(
        turned_back(position_m[:, None] - position_m[:, :, None], own),
        turned_back(poses.direction[:, None], own),
        of_both(poses.noise_m),
        of_both(poses.turn_noise),
    )


def piece_relations(
    poses: NoisyPoses, piece: Float[Tensor, "N A M 4"]
) -> Float[Tensor, "N A M F"]:
    """How each of A agents lies to its pieces, in the frame of each piece.

    And which way the piece's middle is in the agent's own frame. Pieces are told by x,
    y, cosine and sine.
    """
    middle, axis = piece.split(2, dim=-1)
    position_m, own, noise_m, turn_noise = (one[:, :, None] for one in poses)
    offset = position_m - middle
    middle_m = turned_back(-offset, own)
    scaled = middle_m / (noise_m[..., None] + LEAST_NOISE_M)
    return torch.cat(
        [
            relation_features(
                turned_back(offset, axis), turned_back(own, axis), noise_m, turn_noise
            ),
            torch.cat([middle_m, scaled], dim=-1).asinh() / 3,
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
    distance = distance * crossing_factors(prefers_crossings, is_crossing)
    distance = distance.masked_fill(~has_piece[:, None], math.inf)
    num_nearest = min(num_nearest, distance.shape[-1])
    return distance.topk(num_nearest, dim=-1, largest=False).indices


def crossing_factors(
    prefers_crossings: Bool[Tensor, "B Q"], is_crossing: Bool[Tensor, "B P"]
) -> Float[Tensor, "B Q P"]:
    """By how much further each piece seems to each agent."""
    factor = torch.where(prefers_crossings, 0.5, 2.0)[..., None]
    return torch.where(is_crossing[:, None], factor, 1.0)
