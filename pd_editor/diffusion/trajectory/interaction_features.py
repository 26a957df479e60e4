"""Interaction features: where neighbours are predicted to go, as each agent sees it."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

from pd_editor.diffusion.trajectory.decoding import TrajectoryDecoder
from pd_editor.diffusion.trajectory.features import Neighbors

NUM_WAYPOINTS: Final = 8
NUM_INTERACTION_FEATURES: Final = 3 * NUM_WAYPOINTS

_NEAR_M: Final = 4.0
"""Distance at which closeness is one half."""
_LEAST_SQUARE: Final = 1e-6 / _NEAR_M**2


@dataclass(frozen=True, kw_only=True, eq=False)
class InteractionGeometry:
    """All that waypoints of G agents against their K neighbours need but latents.

    Lengths are in units of 4 m; W = 2 * 8 coordinates, all x before all y.
    """

    matrix: Float[Tensor, "10 W2"]
    """Latents to waypoints, and to the same turned by 90 degrees."""
    offset: Float[Tensor, "G W2"]
    row: Int[Tensor, "R"]
    """Row of each neighbour among all agents."""
    cos: Float[Tensor, "R 1"]
    sin: Float[Tensor, "R 1"]
    """Of the neighbour's heading in the agent's frame."""
    position: Float[Tensor, "R W"]
    """Of the neighbour in the agent's frame."""

    @classmethod
    def of(
        cls,
        decoder: TrajectoryDecoder,
        speed_mps: Float[Tensor, "B A"],
        neighbors: Neighbors,
    ) -> "InteractionGeometry":
        """Waypoints are spread evenly over the trajectory, to its end."""
        ends = torch.linspace(
            0, decoder.num_steps, NUM_WAYPOINTS + 1, device=speed_mps.device
        )
        matrix, mean, times = decoder.matrix(ends[1:].long() - 1)
        offset = mean + speed_mps.flatten()[:, None] * times
        x, y, cos, sin = neighbors.pose.flatten(0, 2)[..., None].unbind(-2)
        place = [one.expand(-1, NUM_WAYPOINTS) for one in (x, y)]
        return cls(
            matrix=_with_quarter_turn(matrix) / _NEAR_M,
            offset=_with_quarter_turn(offset) / _NEAR_M,
            row=neighbors.row_of_all().flatten(),
            cos=cos.contiguous(),
            sin=sin.contiguous(),
            position=torch.cat(place, dim=1) / _NEAR_M,
        )

    def features(self, latent: Float[Tensor, "S B A 10"]) -> Float[Tensor, "S R 24"]:
        """Offsets dampened with distance, and closeness, at each waypoint."""
        num_samples, num_agents = len(latent), len(self.offset)
        points = latent.flatten(1, 2) @ self.matrix + self.offset
        own, _ = points.chunk(2, dim=-1)
        theirs, theirs_turned = points.index_select(1, self.row).chunk(2, dim=-1)
        theirs = torch.addcmul(self.position, self.cos, theirs)
        theirs = torch.addcmul(theirs, self.sin, theirs_turned)
        gap = theirs.view(num_samples, num_agents, -1, own.shape[-1]) - own[:, :, None]
        x, y = gap.chunk(2, dim=-1)
        distance = (x.square() + y.square() + _LEAST_SQUARE).sqrt()
        closeness = 1 / (distance + 1)
        found = torch.cat([x * closeness, y * closeness, closeness], dim=-1)
        return found.flatten(1, 2)


def _with_quarter_turn(points: Float[Tensor, "N W"]) -> Float[Tensor, "N W2"]:
    """All x, all y, then both turned by 90 degrees to the left."""
    x, y = points.chunk(2, dim=1)
    return torch.cat([points, -y, x], dim=1)
