"""Features of relative poses between noisy agents and map tokens, at all scales."""

import functools
import math
from typing import Final, NamedTuple

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from pd_editor.generation.core.devices import constant

POSITION_WAVELENGTHS_M: Final = (16.0, 32.0, 64.0, 128.0, 256.0)
"""Wavelengths of the encoding of a position in the square."""
RELATION_WAVELENGTHS_M: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
NUM_POSITION_FEATURES: Final = 4 * len(POSITION_WAVELENGTHS_M)
NUM_AGENT_FEATURES: Final = 4 * len(RELATION_WAVELENGTHS_M) + 8
"""Sinusoids of both coordinates; both coordinates at the scale of a metre and of the noise,
and the sine of the direction at the scale of the noise; distance; direction."""
NUM_PIECE_FEATURES: Final = NUM_AGENT_FEATURES + 4
NUM_FOLDED_FEATURES: Final = 6
"""Directions modulo a half and a quarter turn, and their sines at the scale of the noise."""
NUM_GAP_FEATURES: Final = 10
"""Gaps between two boxes along the four axes, and the largest one; at the scale of a metre
and of the noise."""

_LEAST_NOISE_M: Final = 0.05
_LEAST_TURN_NOISE: Final = 0.02
"""Added to the noise by which features are divided: given agents have none."""
_NUM_GAPS: Final = 5
_LENGTH_SCALE: Final = 1 / 3
"""Factor that scales lengths, in metres or in units of the noise, to about one."""


class NoisyPoses(NamedTuple):
    """Poses of A agents in S versions of B scenes, as complex numbers."""

    position_m: Complex[Tensor, "B S A"]
    direction: Complex[Tensor, "B S A"]
    """Directions as complex numbers of length one."""


class NoiseFactors(NamedTuple):
    """Factors of features that depend on the noise of poses."""

    fading: Float[Tensor, "*b F"]
    """Of all features: those of waves fade out, lengths are scaled to about one."""
    lengths: Float[Tensor, "*b L"]
    """Factors of lengths: 1, or the inverse of the noise."""


def waves(
    points_m: Float[Tensor, "*b 2"], wavelengths_m: tuple[float, ...]
) -> Float[Tensor, "*b F"]:
    """Sines and then cosines of both coordinates at some wavelengths."""
    phase = _phase(points_m, wavelengths_m)
    return torch.cat([phase.sin(), phase.cos()], dim=-1)


def _phase(
    points_m: Float[Tensor, "*b 2"], wavelengths_m: tuple[float, ...]
) -> Float[Tensor, "*b F"]:
    # Products with zeros and rates: faster than broadcasting over an axis of two.
    return points_m @ _rate_matrix(wavelengths_m, points_m.device)


def fading(
    wavelengths_m: tuple[float, ...], noise_m: Float[Tensor, "*b"]
) -> Float[Tensor, "*b F"]:
    """Factors of sines, or cosines, of points with noise of some standard deviation.

    The result is the expectation over clean points: wavelengths below the noise vanish.

    Source: Barron et al., Mip-NeRF, 2021 (integrated positional encoding).
    """
    rates = _rates(wavelengths_m, noise_m.device).repeat_interleave(2)
    return (noise_m[..., None] * rates).square().mul(-0.5).exp()


def noise_factors(
    noise_m: Float[Tensor, "*b"],
    turn_noise: Float[Tensor, "*b"],
    *,
    num_offsets: int,
    folds_turns: bool = False,
    sees_gaps: bool = False,
) -> NoiseFactors:
    """Factors of relations with one offset and a direction, or with two offsets.

    Noises are standard deviations, in radians while small. ``folds_turns`` adds
    directions modulo a half and a quarter turn, ``sees_gaps`` gaps between boxes.
    """
    one, near = torch.ones_like(noise_m), 1 / (noise_m + _LEAST_NOISE_M)
    turn = 1 / (turn_noise + _LEAST_TURN_NOISE)
    lengths = [one, one, near, near, turn]
    lengths += [one, one, near, near] * (num_offsets - 1)
    num_first = len(lengths)
    if folds_turns:
        lengths += [turn / 2, turn / 4]
    if sees_gaps:
        lengths += [one] * _NUM_GAPS + [near] * _NUM_GAPS
    faded = fading(RELATION_WAVELENGTHS_M, noise_m)
    scale = [_LENGTH_SCALE] * (num_first + 1) + [1.0] * 2
    scale += [1.0] * 4 * folds_turns + [_LENGTH_SCALE] * (len(lengths) - num_first)
    others = constant(scale, noise_m).expand(*noise_m.shape, -1)
    return NoiseFactors(
        torch.cat([faded, faded, others], dim=-1), torch.stack(lengths, dim=-1)
    )


@functools.lru_cache
def _rates(
    wavelengths_m: tuple[float, ...], device: torch.device
) -> Float[Tensor, "W"]:
    """Radians per metre; computed once, outside of the differentiated graph."""
    with torch.inference_mode(mode=False):
        return torch.tensor([2 * math.pi / one for one in wavelengths_m], device=device)


@functools.lru_cache
def _rate_matrix(
    wavelengths_m: tuple[float, ...], device: torch.device
) -> Float[Tensor, "2 F"]:
    """From x and y to their phases, those of each wavelength together."""
    with torch.inference_mode(mode=False):
        rates = _rates(wavelengths_m, device)
        return torch.kron(rates, torch.eye(2, device=device))


class BoxPairs(NamedTuple):
    """Half sizes of the boxes of each pair of A agents in B scenes.

    The last but one axis is the frame (first or second agent), the last one is along and
    across.
    """

    own: Float[Tensor, "B 1 A A 2 2"]
    """Half sizes of the agent whose frame it is."""
    other: Float[Tensor, "B 1 A A 2 2"]
    crossed: Float[Tensor, "B 1 A A 2 2"]
    """Half sizes of the other agent, its width along and its length across."""

    @classmethod
    def of(cls, size_m: Float[Tensor, "B A 2"]) -> "BoxPairs":
        """Make all pairs of agents."""
        half = size_m[:, None] / 2
        first = half[:, :, :, None].expand(-1, -1, -1, half.shape[2], -1)
        second = first.transpose(2, 3)
        other = torch.stack([second, first], dim=-2)
        return cls(
            own=torch.stack([first, second], dim=-2),
            other=other,
            crossed=other.flip(-1),
        )

    def gaps_m(
        self,
        offset: Complex[Tensor, "B S A A"],
        offset_back: Complex[Tensor, "B S A A"],
        direction: Complex[Tensor, "B S A A"],
    ) -> Float[Tensor, "B S A A 5"]:
        """Gaps along the axes of both boxes, and the largest one; below 0 they overlap.

        Boxes are disjoint if the largest gap is above 0 (separating axes).
        ``offset_back`` is the offset in the frame of the second box.
        """
        turn = torch.view_as_real(direction).abs()[..., None, :]
        reach = torch.addcmul(self.own, self.other, turn[..., :1])
        reach = torch.addcmul(reach, self.crossed, turn[..., 1:])
        in_frames = torch.stack([offset, offset_back], dim=-1)
        gaps = (torch.view_as_real(in_frames).abs() - reach).flatten(-2)
        return torch.cat([gaps, gaps.amax(dim=-1, keepdim=True)], dim=-1)


def agent_relations(
    poses: NoisyPoses,
    noise: NoiseFactors,
    *,
    folds_turns: bool = False,
    boxes: BoxPairs | None = None,
) -> Float[Tensor, "B S A A F"]:
    """Relations of agents: offset and direction of others in each agent's frame.

    ``folds_turns`` adds directions modulo a half and a quarter turn, ``boxes`` (sizes)
    the gaps between boxes.
    """
    back = poses.direction.conj_physical()[..., None]
    apart = poses.position_m[..., None, :] - poses.position_m[..., None]
    offset, direction = apart * back, poses.direction[..., None, :] * back
    gaps = None if boxes is None else boxes.gaps_m(offset, apart * back.mT, direction)
    return _relation_features(
        offset, direction, noise, folds_turns=folds_turns, gaps_m=gaps
    )


def piece_relations(
    poses: NoisyPoses,
    middle_m: Complex[Tensor, "B S A M"],
    axis: Complex[Tensor, "B S A M"],
    noise: NoiseFactors,
    *,
    folds_turns: bool = False,
) -> Float[Tensor, "B S A M F"]:
    """Relations of each agent to its M map tokens, in the frame of each token.

    They include the token's midpoint in the agent's frame. With ``folds_turns``
    directions modulo a half and a quarter turn come last.
    """
    back, own = axis.conj_physical(), poses.direction[..., None]
    offset = poses.position_m[..., None] - middle_m
    own_offset = -offset * own.conj_physical()
    return _relation_features(
        offset * back, own * back, noise, own_offset, folds_turns=folds_turns
    )


def _relation_features(
    offset: Complex[Tensor, "*b"],
    direction: Complex[Tensor, "*b"],
    noise: NoiseFactors,
    own_offset: Complex[Tensor, "*b"] | None = None,
    *,
    folds_turns: bool = False,
    gaps_m: Float[Tensor, "*b G"] | None = None,
) -> Float[Tensor, "*b F"]:
    """Features of an offset and a direction in one frame, with optional parts.

    Far offsets are dampened. Optional parts are an offset in another frame, the direction
    modulo a half and a quarter turn (cars park in either direction along a kerb, and
    perpendicular in lots), and gaps between boxes.
    """
    offset_m = torch.view_as_real(offset)
    direction_xy = torch.view_as_real(direction)
    lengths = [offset_m, offset_m, direction_xy[..., 1:]]
    more: list[Tensor] = []
    if own_offset is not None:
        lengths += [torch.view_as_real(own_offset)] * 2
    if folds_turns:
        half = direction.square()
        folded = torch.view_as_real(torch.stack([half, half.square()], dim=-1))
        lengths.append(folded[..., 1])
        more.append(folded.flatten(-2))
    if gaps_m is not None:
        lengths += [gaps_m, gaps_m]
    scaled = _asinh(torch.cat(lengths, dim=-1) * noise.lengths)
    if folds_turns or gaps_m is not None:
        num_first = 5 if own_offset is None else 9
        scaled, last = scaled.tensor_split([num_first], dim=-1)
        more.append(last)
    phase = _phase(offset_m, RELATION_WAVELENGTHS_M)
    distance = offset.abs().log1p()[..., None]
    found = [phase.sin(), phase.cos(), scaled, distance, direction_xy, *more]
    return torch.cat(found, dim=-1).mul_(noise.fading)


def _asinh(values: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Inverse hyperbolic sine by vectorised functions; torch's own is seven times slower."""
    square = torch.addcmul(values.new_ones(()), values, values)
    return torch.log1p(values.abs() + (square.sqrt() - 1)).copysign(values)


def rotated_back(
    vectors: Float[Tensor, "*#b 2"], direction: Float[Tensor, "*#b 2"]
) -> Float[Tensor, "*b 2"]:
    """Transform vectors to frames whose x axis is a unit direction."""
    return torch.view_as_real(
        as_complex(vectors) * as_complex(direction).conj_physical()
    )


def as_complex(vectors: Float[Tensor, "*b 2"]) -> Complex[Tensor, "*b"]:
    """Convert vectors to complex numbers, which are rotated by one product."""
    vectors = vectors.contiguous()
    # A slice counts as contiguous whatever the stride of a dimension of size 1.
    if any(one % 2 for one in (vectors.storage_offset(), *vectors.stride()[:-1])):
        vectors = vectors.clone(memory_format=torch.contiguous_format)
    return torch.view_as_complex(vectors)
