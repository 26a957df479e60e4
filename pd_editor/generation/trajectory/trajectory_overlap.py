"""Differentiable overlap depth of neighbours' boxes along their trajectories.

Boxes are approximated by rows of discs.
"""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.generation.core.devices import constant
from pd_editor.generation.inputs.scene_batch import SceneTensors
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.features import Neighbors

_NUM_TIMES: Final = 12
_DISCS: Final = (-1.0, 0.0, 1.0)
_HELD_M: Final = 0.2
"""An agent that moves less between two steps keeps its heading."""


def overlap_depth_m(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S B A 10"],
    neighbors: Neighbors,
    scene: SceneTensors,
) -> Float[Tensor, "S B A K"]:
    """Largest overlap depth over time of each agent with each of its K neighbours."""
    flat = latent.flatten(1, 2)
    x, y = _disc_centers(
        decoder, flat, scene.agent_speed.flatten(), scene.agent_size.flatten(0, 1)
    )
    near = neighbors.row_of_all()[:, :, 1:].flatten(0, 1)
    pose = neighbors.pose[:, :, 1:].flatten(0, 1)[..., None, None, :]
    rows = near.flatten()
    their_x = x.index_select(1, rows).unflatten(1, near.shape)
    their_y = y.index_select(1, rows).unflatten(1, near.shape)
    gap_x = pose[..., 2] * their_x - pose[..., 3] * their_y + pose[..., 0]
    gap_y = pose[..., 3] * their_x + pose[..., 2] * their_y + pose[..., 1]
    own_x, own_y = x[:, :, None, :, :, None], y[:, :, None, :, :, None]
    distance = torch.sqrt(
        (gap_x[..., None, :] - own_x).square()
        + (gap_y[..., None, :] - own_y).square()
        + 1e-4
    )
    radius = 0.5 * scene.agent_size[..., 1].flatten()
    reach = radius[:, None] + radius[near]
    depth = (reach - distance.amin(dim=(-1, -2, -3))).clamp_min(0)
    depth = torch.where(neighbors.exists[:, :, 1:].flatten(0, 1), depth, 0.0)
    return depth.unflatten(1, latent.shape[1:3])


def _disc_centers(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S G 10"],
    speed: Float[Tensor, "G"],
    size: Float[Tensor, "G 2"],
) -> tuple[Float[Tensor, "S G T D"], Float[Tensor, "S G T D"]]:
    """Centres of the discs along each box, in the frame of its agent's current pose."""
    steps = torch.linspace(0, decoder.num_steps, _NUM_TIMES + 1, device=latent.device)
    x, y = decoder.points(latent, speed, steps[1:].long() - 1)
    ahead_x = torch.diff(x, dim=-1, prepend=torch.zeros_like(x[..., :1])) + _HELD_M
    ahead_y = torch.diff(y, dim=-1, prepend=torch.zeros_like(y[..., :1]))
    length = torch.sqrt(ahead_x.square() + ahead_y.square() + 1e-6)
    half = 0.5 * (size[:, 0] - size[:, 1]).clamp_min(0)
    along = half[:, None, None] * constant(_DISCS, latent)
    return (
        x[..., None] + (ahead_x / length)[..., None] * along,
        y[..., None] + (ahead_y / length)[..., None] * along,
    )
