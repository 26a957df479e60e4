"""Where neighbours are going, as seen by each agent, in few operations."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.diffusion.trajectory.features import Neighbors
from pd_editor.diffusion.trajectory.interaction_features import NEAR_M

_LEAST_SQUARE: Final = 1e-6


class WayLines:
    """Way points of all neighbours against one's own, as in ``WayPoints``."""

    def __init__(
        self,
        matrix: Float[Tensor, "10 W"],
        offset: Float[Tensor, "G W"],
        neighbors: Neighbors,
    ) -> None:
        """Matrix and offset make way points of the latents of all G agents."""
        half = matrix.shape[1] // 2
        # With a quarter turn beside it, a turn is two products.
        self._matrix = torch.cat([matrix, -matrix[:, half:], matrix[:, :half]], dim=1)
        self._offset = torch.cat([offset, -offset[:, half:], offset[:, :half]], dim=1)
        self._half = half
        scenes, agents, number = neighbors.row.shape
        first = agents * torch.arange(scenes, device=offset.device)
        self._neighbor = (neighbors.row + first[:, None, None]).flatten()
        self._num_neighbors = number
        x, y, cos, sin = neighbors.pose.flatten(0, 2)[..., None].unbind(-2)
        self._cos, self._sin = cos.contiguous(), sin.contiguous()
        self._place = torch.cat([x.expand(-1, half), y.expand(-1, half)], dim=1)

    def features(self, guess: Float[Tensor, "S B A 10"]) -> Float[Tensor, "N 24"]:
        """Directions and closeness; closeness per metre."""
        points = (guess.flatten(1, 2) @ self._matrix).add_(self._offset)
        own = points[..., : 2 * self._half]
        theirs = points.index_select(1, self._neighbor)
        along, across = theirs.chunk(2, dim=-1)
        gap = torch.addcmul(self._place, self._cos, along)
        gap = gap.addcmul_(self._sin, across)
        gap = (
            gap.unflatten(1, (-1, self._num_neighbors))
            .sub_(own[:, :, None])
            .flatten(1, 2)
        )
        square = gap.square()
        near = square[..., : self._half] + square[..., self._half :]
        near = near.add_(_LEAST_SQUARE).sqrt_().add_(NEAR_M).reciprocal_()
        ahead, beside = gap.chunk(2, dim=-1)
        return torch.cat([ahead * near, beside * near, near], dim=-1).flatten(0, 1)
