"""How deep boxes overlap, as a smooth number: three discs for each box."""

from typing import Final

import torch
from jaxtyping import Float
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
    position_m = states[..., :2] * POSITION_UNIT_M
    axis = unit_vectors(states[..., 2:4])
    length, width = scene.agent_size.unbind(-1)
    reach = ((length - width) / 2).clamp_min(0)[..., None, None]
    places = torch.tensor(_PLACES, device=states.device)[:, None]
    discs = position_m[..., None, :] + axis[..., None, :] * places * reach
    offset = discs[..., :, None, :, None, :] - discs[..., None, :, None, :, :]
    # The square root of 0 has no slope.
    distance = (offset.square().sum(dim=-1) + 1e-6).sqrt().flatten(-2).amin(dim=-1)
    radius = torch.minimum(length, width) / 2
    depth = (radius[..., None] + radius[..., None, :] - distance).clamp_min(0)
    walks = scene.agent_kind == _PEDESTRIAN
    counts = ~(walks[..., None] & walks[..., None, :])
    counts &= scene.has_agent[..., None] & scene.has_agent[..., None, :]
    counts &= ~torch.eye(counts.shape[-1], dtype=torch.bool, device=states.device)
    return depth * counts
