"""Where neighbours are going, as seen by each agent."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.diffusion.inputs.trajectory_pca import (
    NUM_ACROSS,
    NUM_ALONG,
    TrajectoryBasis,
)
from pd_editor.diffusion.trajectory.context import TrajectoryContext
from pd_editor.windows.packed_scene import LATENT_SIZE

NUM_WAY_POINTS: Final = 8
NUM_WAY_FEATURES: Final = 3 * NUM_WAY_POINTS

NEAR_M: Final = 4.0
"""Distance at which closeness is one half."""


class TrajectoryDecoder(nn.Module):
    """A trajectory basis as tensors, stored with the weights."""

    def __init__(self, basis: TrajectoryBasis | None, num_steps: int) -> None:
        """Without a basis, one is expected to be loaded with the weights."""
        super().__init__()
        arrays = _empty(num_steps) if basis is None else basis.arrays()
        for name, values in arrays.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    @property
    def num_steps(self) -> int:
        """Number of future points."""
        return len(self.get_buffer("mean_m"))

    @property
    def basis(self) -> TrajectoryBasis:
        """The basis in NumPy."""
        return TrajectoryBasis.of_arrays(
            {
                name: values.double().cpu().numpy()
                for name, values in self.named_buffers()
            }
        )

    def matrix(self, steps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Matrix [10 2T], mean [2T] and times [2T] for x and then y at T steps.

        Points are ``latent @ matrix + mean + speed * times``.
        """
        buffers = dict(self.named_buffers())
        scale = buffers["scale_m"][:, None]
        along = buffers["along"][:, steps] * scale[:NUM_ALONG]
        across = buffers["across"][:, steps] * scale[NUM_ALONG:]
        empty = torch.zeros_like(along)
        matrix = torch.cat(
            [torch.cat([along, empty], 1), torch.cat([empty[:NUM_ACROSS], across], 1)]
        )
        mean = buffers["mean_m"][steps]
        times = buffers["step_s"] * (steps + 1)
        still = torch.zeros_like(mean)
        return matrix, torch.cat([mean, still]), torch.cat([times, still])

    def still(self, speed: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape 10"]:
        """Latents of not moving at all."""
        buffers = dict(self.named_buffers())
        along = buffers["along"] / buffers["scale_m"][:NUM_ALONG, None]
        steps = torch.arange(1, self.num_steps + 1, device=speed.device)
        times = buffers["step_s"] * steps.to(speed)
        back = -(speed[..., None] * (along @ times) + along @ buffers["mean_m"])
        return nn.functional.pad(back, (0, NUM_ACROSS))

    def points(
        self,
        latent: Float[Tensor, "*shape 10"],
        speed: Float[Tensor, "*#shape"],
        steps: Tensor,
    ) -> tuple[Float[Tensor, "*shape T"], Float[Tensor, "*shape T"]]:
        """Places at some steps, x and y, in each agent's own frame."""
        matrix, mean, times = self.matrix(steps)
        points = latent.to(matrix) @ matrix + mean + speed[..., None] * times
        x, y = points.chunk(2, dim=-1)
        return x, y


class WayPoints(TrajectoryDecoder):
    """Some points of each neighbour's future against one's own at the same times."""

    def __init__(self, basis: TrajectoryBasis | None, num_steps: int) -> None:
        """Way points are spread evenly over the future, to its end."""
        super().__init__(basis, num_steps)
        spread = torch.linspace(0, num_steps, NUM_WAY_POINTS + 1)[1:].long() - 1
        self.register_buffer("steps", spread, persistent=False)

    def line(
        self, speed: Float[Tensor, "G"]
    ) -> tuple[Float[Tensor, "10 W"], Float[Tensor, "G W"]]:
        """Matrix and offset that make way points of latents."""
        matrix, mean, times = self.matrix(self.get_buffer("steps"))
        return matrix, mean + speed[:, None] * times

    def forward(
        self, latent: Float[Tensor, "S G 10"], context: TrajectoryContext
    ) -> Float[Tensor, "S G K 24"]:
        """Directions and closeness of all neighbours at all way points."""
        points = latent @ context.way_matrix + context.way_offset
        own_x, own_y = points[:, :, None].chunk(2, dim=-1)
        their_x, their_y = points[:, context.neighbor].chunk(2, dim=-1)
        x, y, cos, sin = context.neighbor_pose[..., None, :].unbind(-1)
        gap_x = cos * their_x - sin * their_y + (x - own_x)
        gap_y = sin * their_x + cos * their_y + (y - own_y)
        near = 1 / (torch.sqrt(gap_x.square() + gap_y.square() + 1e-6) + NEAR_M)
        return torch.cat([gap_x * near, gap_y * near, NEAR_M * near], dim=-1)


def _empty(num_steps: int) -> dict[str, list[float] | list[list[float]]]:
    return {
        "step_s": [0.1],
        "mean_m": [0.0] * num_steps,
        "along": [[0.0] * num_steps] * NUM_ALONG,
        "across": [[0.0] * num_steps] * NUM_ACROSS,
        "scale_m": [1.0] * LATENT_SIZE,
    }
