"""Relative poses of noisy agents and of map tokens as features, at all scales at once."""

import functools
import math
from typing import Final, NamedTuple

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

POSITION_WAVELENGTHS_M: Final = (16.0, 32.0, 64.0, 128.0, 256.0)
"""Scales at which a position in the square is encoded."""
RELATION_WAVELENGTHS_M: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
NUM_POSITION_FEATURES: Final = 4 * len(POSITION_WAVELENGTHS_M)
NUM_AGENT_FEATURES: Final = 4 * len(RELATION_WAVELENGTHS_M) + 8
"""Waves of both coordinates; both at the scale of a metre and of the noise, and the sine
of the direction at the scale of the noise; distance; direction."""
NUM_PIECE_FEATURES: Final = NUM_AGENT_FEATURES + 4
NUM_FOLDED_FEATURES: Final = 6
"""Directions modulo a half and a quarter turn, and their sines at the scale of the noise."""
NUM_GAP_FEATURES: Final = 10
"""Gaps between two boxes along the four axes, and the largest; at the scale of a metre
and of the noise."""

_LEAST_NOISE_M: Final = 0.05
_LEAST_TURN_NOISE: Final = 0.02
_NEAR: Final = 2
_TURN: Final = 4
"""Places in ``NoiseFactors.lengths`` of one over the noise of offsets, of directions."""
"""Added where something is given at the scale of the noise: given agents have none."""


class NoisyPoses(NamedTuple):
    """Poses of A agents in S versions of B scenes, as complex numbers."""

    position_m: Complex[Tensor, "B S A"]
    direction: Complex[Tensor, "B S A"]
    """Of length one."""


class NoiseFactors(NamedTuple):
    """What the noise of poses makes of features."""

    fading: Float[Tensor, "*b F"]
    """Of sines, and again of cosines."""
    lengths: Float[Tensor, "*b L"]
    """1, or one over the noise, of what is given at the scale of the noise."""


def waves(
    points_m: Float[Tensor, "*b 2"], wavelengths_m: tuple[float, ...]
) -> Float[Tensor, "*b F"]:
    """Sines and then cosines of both coordinates at some wavelengths."""
    phase = _phase(points_m, wavelengths_m)
    return torch.cat([phase.sin(), phase.cos()], dim=-1)


def _phase(
    points_m: Float[Tensor, "*b 2"], wavelengths_m: tuple[float, ...]
) -> Float[Tensor, "*b F"]:
    rates = _rates(wavelengths_m, points_m.device)
    return (points_m[..., None, :] * rates[:, None]).flatten(-2)


def fading(
    wavelengths_m: tuple[float, ...], noise_m: Float[Tensor, "*b"]
) -> Float[Tensor, "*b F"]:
    """Factors of sines, or of cosines, whose points have noise of some deviation.

    They make what is expected of the waves of clean points: waves shorter than the
    noise fade out.

    Source: Barron et al., Mip-NeRF, 2021 (integrated positional encoding).
    """
    rates = _rates(wavelengths_m, noise_m.device).repeat_interleave(2)
    return (noise_m[..., None] * rates).square().mul(-0.5).exp()


def noise_factors(
    noise_m: Float[Tensor, "*b"], turn_noise: Float[Tensor, "*b"], *, num_offsets: int
) -> NoiseFactors:
    """Factors of relations with one offset and a direction, or with two offsets.

    Args:
        noise_m: standard deviation of offsets.
        turn_noise: of directions, in radians while small.
        num_offsets: 1 or 2.
    """
    one, near = torch.ones_like(noise_m), 1 / (noise_m + _LEAST_NOISE_M)
    lengths = [one, one, near, near, 1 / (turn_noise + _LEAST_TURN_NOISE)]
    lengths += [one, one, near, near] * (num_offsets - 1)
    return NoiseFactors(
        fading(RELATION_WAVELENGTHS_M, noise_m), torch.stack(lengths, dim=-1)
    )


@functools.lru_cache
def _rates(
    wavelengths_m: tuple[float, ...], device: torch.device
) -> Float[Tensor, "W"]:
    """Radians for each metre; made once, outside of what is differentiated."""
    with torch.inference_mode(mode=False):
        return torch.tensor([2 * math.pi / one for one in wavelengths_m], device=device)


def agent_relations(
    poses: NoisyPoses,
    noise: NoiseFactors,
    *,
    folds_turns: bool = False,
    boxes: "BoxPairs | None" = None,
) -> Float[Tensor, "B S A A F"]:
    """How each agent sees every other one: offset and direction in its own frame.

    Args:
        poses: of the agents.
        noise: of each pair.
        folds_turns: with directions modulo a half and a quarter turn as well.
        boxes: with the gaps between boxes as well.
    """
    back = poses.direction.conj_physical()[..., None]
    offset = poses.position_m[..., None, :] - poses.position_m[..., None]
    direction = poses.direction[..., None, :] * back
    found = [_relation_features(offset * back, direction, noise)]
    if folds_turns:
        found.append(folded_directions(direction, noise))
    if boxes is not None:
        found.append(box_gaps(poses, boxes, noise))
    return found[0] if len(found) == 1 else torch.cat(found, dim=-1)


def piece_relations(
    poses: NoisyPoses,
    middle_m: Complex[Tensor, "B S A M"],
    axis: Complex[Tensor, "B S A M"],
    noise: NoiseFactors,
    *,
    folds_turns: bool = False,
) -> Float[Tensor, "B S A M F"]:
    """How each agent lies to its M map tokens, in the frame of each token.

    And where the token's middle is in the agent's own frame. With ``folds_turns``
    directions modulo a half and a quarter turn come last.
    """
    back, own = axis.conj_physical(), poses.direction[..., None]
    offset = poses.position_m[..., None] - middle_m
    own_offset = -offset * own.conj_physical()
    direction = own * back
    found = _relation_features(offset * back, direction, noise, own_offset)
    if not folds_turns:
        return found
    return torch.cat([found, folded_directions(direction, noise)], dim=-1)


def _relation_features(
    offset: Complex[Tensor, "*b"],
    direction: Complex[Tensor, "*b"],
    noise: NoiseFactors,
    own_offset: Complex[Tensor, "*b"] | None = None,
) -> Float[Tensor, "*b F"]:
    """An offset and a direction in one frame, and perhaps an offset in another one.

    Far offsets are dampened.
    """
    offset_m = torch.view_as_real(offset)
    direction_xy = torch.view_as_real(direction)
    lengths = [offset_m, offset_m, direction_xy[..., 1:]]
    if own_offset is not None:
        lengths += [torch.view_as_real(own_offset)] * 2
    phase = _phase(offset_m, RELATION_WAVELENGTHS_M)
    return torch.cat(
        [
            phase.sin() * noise.fading,
            phase.cos() * noise.fading,
            (torch.cat(lengths, dim=-1) * noise.lengths).asinh() / 3,
            offset.abs().log1p()[..., None] / 3,
            direction_xy,
        ],
        dim=-1,
    )


def folded_directions(
    direction: Complex[Tensor, "*b"], noise: NoiseFactors
) -> Float[Tensor, "*b 6"]:
    """Directions modulo a half and a quarter turn.

    Cars park along a kerb facing either way, and in lots across the row.

    Args:
        direction: numbers of length one.
        noise: the factors of the relations that the directions belong to.
    """
    half = direction.square()
    folded = torch.view_as_real(torch.stack([half, half.square()], dim=-1))
    sines = folded[..., 1] * noise.lengths[..., _TURN : _TURN + 1]
    return torch.cat([folded.flatten(-2), (sines * 0.5).asinh() / 3], dim=-1)


class BoxPairs(NamedTuple):
    """Half sizes of the boxes of each pair of A agents in B scenes.

    The third axis from the right is the frame, of the first agent and of the second
    one; the last axis is along and across.
    """

    own: Float[Tensor, "B 1 A A 2 2"]
    """Of the agent whose frame it is."""
    other: Float[Tensor, "B 1 A A 2 2"]
    crossed: Float[Tensor, "B 1 A A 2 2"]
    """Of the other agent, its width along and its length across."""

    @classmethod
    def of(cls, size_m: Float[Tensor, "B A 2"]) -> "BoxPairs":
        """All pairs."""
        half = size_m[:, None] / 2
        first = half[:, :, :, None].expand(-1, -1, -1, half.shape[2], -1)
        second = first.transpose(2, 3)
        other = torch.stack([second, first], dim=-2)
        return cls(
            own=torch.stack([first, second], dim=-2),
            other=other,
            crossed=other.flip(-1),
        )


def box_gaps(
    poses: NoisyPoses, boxes: BoxPairs, noise: NoiseFactors
) -> Float[Tensor, "B S A A 10"]:
    """Gaps between the boxes of each pair along the axes of both; below 0 they overlap.

    Boxes are apart where the largest of the four is above 0 (separating axes).
    """
    back = poses.direction.conj_physical()[..., None]
    offset = poses.position_m[..., None, :] - poses.position_m[..., None]
    # The same offset in the frame of the other agent, but for its sign.
    in_frames = torch.stack([offset * back, offset * back.mT], dim=-1)
    turn = torch.view_as_real(poses.direction[..., None, :] * back).abs()
    reach = (
        boxes.own
        + boxes.other * turn[..., None, :1]
        + boxes.crossed * turn[..., None, 1:]
    )
    gap = (torch.view_as_real(in_frames).abs() - reach).flatten(-2)
    gap = torch.cat([gap, gap.amax(dim=-1, keepdim=True)], dim=-1)
    scaled = gap * noise.lengths[..., _NEAR : _NEAR + 1]
    return torch.cat([gap, scaled], dim=-1).asinh() / 3


def rotated_back(
    vectors: Float[Tensor, "*#b 2"], direction: Float[Tensor, "*#b 2"]
) -> Float[Tensor, "*b 2"]:
    """Vectors in frames whose x axis is a unit direction."""
    return torch.view_as_real(
        as_complex(vectors) * as_complex(direction).conj_physical()
    )


def as_complex(vectors: Float[Tensor, "*b 2"]) -> Complex[Tensor, "*b"]:
    """As complex numbers, which one operation turns."""
    vectors = vectors.contiguous()
    # A part of a row counts as contiguous where there is only one row.
    is_even = vectors.storage_offset() % 2 == 0
    return torch.view_as_complex(vectors if is_even else vectors.clone())


def crossing_factors(
    prefers_crossings: Bool[Tensor, "B A"], is_crossing: Bool[Tensor, "B P"]
) -> Float[Tensor, "B A P"]:
    """By how much further each map token seems to each agent.

    To a pedestrian crosswalks seem at half the distance, to others at twice.
    """
    factor = torch.where(prefers_crossings, 0.5, 2.0)[..., None]
    return torch.where(is_crossing[:, None], factor, 1.0)
