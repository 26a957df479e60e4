"""How deep boxes overlap, as a smooth number: three discs for each box."""

from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.pose_encoding import POSITION_UNIT_M, unit_vectors
from pd_editor.diffusion.scene_tensors import SceneTensors
from pd_editor.windows.scene_features import AGENT_KINDS

_PEDESTRIAN: Final = len(AGENT_KINDS) - 1
_PLACES: Final = (-1.0, 0.0, 1.0)


def overlap_depth_m(
    states: Float[Tensor, "*b A 5"], scene: SceneTensors
) -> Float[Tensor, "*b A A"]:
    """Depth in metres by which each pair of boxes overlaps, 0 where it does not.

    A box counts as three discs of its width along its length. Two pedestrians never
    overlap: they walk in groups.
    """
    # The square root of 0 has no slope.
    distance = (_offsets_m(states, scene).square().sum(dim=-1) + 1e-6).sqrt()
    depth = _radii_m(scene) - distance.amin(dim=-1)
    return depth.clamp_min(0) * _counts(scene)


def overlap_vectors_m(
    states: Float[Tensor, "*b A 5"], scene: SceneTensors, *, gap_m: float = 0.0
) -> Float[Tensor, "*b A A 2"]:
    """How the first of each pair has to move to be out of the second, 0 if it is.

    Corners stick out of the discs: a gap of 0.4 m keeps those of cars apart.
    """
    offset = _offsets_m(states, scene)
    nearest = offset.square().sum(dim=-1).argmin(dim=-1, keepdim=True)
    offset = offset.gather(-2, nearest[..., None].expand(*nearest.shape, 2))[..., 0, :]
    # Of two in one place, the first in the list goes ahead.
    axis = unit_vectors(states[..., 2:4])[..., :, None, :]
    sign = torch.ones_like(offset[..., 0]).triu() * 2 - 1
    offset = offset + 1e-3 * sign[..., None] * axis
    distance = offset.norm(dim=-1)
    depth = (_radii_m(scene) + gap_m - distance).clamp_min(0) * _counts(scene)
    return offset * (depth / distance.clamp_min(1e-6))[..., None]


def _offsets_m(
    states: Float[Tensor, "*b A 5"], scene: SceneTensors
) -> Float[Tensor, "*b A A 9 2"]:
    """From each disc of the second of a pair to each of the first."""
    position_m = states[..., :2] * POSITION_UNIT_M
    axis = unit_vectors(states[..., 2:4])
    length, width = scene.agent_size.unbind(-1)
    reach = ((length - width) / 2).clamp_min(0)[..., None, None]
    places = torch.tensor(_PLACES, device=states.device)[:, None]
    discs = position_m[..., None, :] + axis[..., None, :] * places * reach
    offset = discs[..., :, None, :, None, :] - discs[..., None, :, None, :, :]
    return offset.flatten(-3, -2)


def _radii_m(scene: SceneTensors) -> Float[Tensor, "B A A"]:
    radius = scene.agent_size.amin(dim=-1) / 2
    return radius[..., None] + radius[..., None, :]


def _counts(scene: SceneTensors) -> Bool[Tensor, "B A A"]:
    walks = scene.agent_kind == _PEDESTRIAN
    counts = ~(walks[..., None] & walks[..., None, :])
    counts &= scene.has_agent[..., None] & scene.has_agent[..., None, :]
    eye = torch.eye(counts.shape[-1], dtype=torch.bool, device=counts.device)
    return counts & ~eye
