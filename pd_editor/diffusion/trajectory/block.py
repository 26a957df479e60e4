"""A block of the second stage: agents look at lanes, candidates and neighbours."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.diffusion.trajectory.context import (
    BlockMemory,
    Memory,
    TrajectoryContext,
)
from pd_editor.diffusion.trajectory.interaction_features import NUM_WAY_FEATURES
from pd_editor.windows.packed_scene import LATENT_SIZE


class AgentBlock(nn.Module):
    """Three attentions side by side, a feed-forward part, and a guess at the result.

    The attentions share their input and output projections, so that a block is few
    operations: at a few agents it is their number that takes the time.
    """

    def __init__(self, width: int, num_heads: int, edge_width: int) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.width = width
        self.norm = nn.LayerNorm(width)
        self.queries = nn.Linear(width, 5 * width)
        """Of pieces, candidates and neighbours; keys and values for neighbours."""
        self.way_in = nn.Linear(NUM_WAY_FEATURES, edge_width, bias=False)
        self.edge_out = nn.Linear(edge_width, 2 * width, bias=False)
        self.attended = nn.Linear(3 * width, width)
        self.feed_forward = nn.Sequential(
            nn.LayerNorm(width),
            nn.Linear(width, 4 * width),
            nn.ReLU(),
            nn.Linear(4 * width, width),
        )
        self.guess = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, LATENT_SIZE))

    def forward(
        self,
        hidden: Float[Tensor, "S G E"],
        ways: Float[Tensor, "S G K 24"] | None,
        memory: BlockMemory,
        context: TrajectoryContext,
    ) -> tuple[Float[Tensor, "S G E"], Float[Tensor, "S G 10"]]:
        """Hidden states after the block, and the network output guessed from them."""
        queries, own = self.queries(self.norm(hidden)).split(
            [3 * self.width, 2 * self.width], dim=-1
        )
        to_pieces, to_candidates, to_neighbors = queries.chunk(3, dim=-1)
        seen = torch.cat(
            [
                self._recall(to_pieces, memory.pieces),
                self._recall(to_candidates, memory.candidates),
                self._neighbors(to_neighbors, own, ways, memory, context),
            ],
            dim=-1,
        )
        hidden = hidden + self.attended(seen)
        hidden = hidden + self.feed_forward(hidden)
        return hidden, self.guess(hidden)

    def _recall(
        self, query: Float[Tensor, "S G E"], memory: Memory
    ) -> Float[Tensor, "S G E"]:
        heads = query.unflatten(-1, (self.num_heads, -1)).permute(1, 2, 0, 3)
        if torch.is_grad_enabled():
            # The fused kernel is slow backwards where queries are few.
            weights = heads * heads.shape[-1] ** -0.5 @ memory.keys.mT
            weights = weights.masked_fill(~memory.exists, -torch.inf).softmax(dim=-1)
            found = weights.to(memory.values.dtype) @ memory.values
        else:
            found = nn.functional.scaled_dot_product_attention(
                heads, memory.keys, memory.values, attn_mask=memory.exists
            )
        return found.permute(2, 0, 1, 3).flatten(-2)

    def _neighbors(
        self,
        query: Float[Tensor, "S G E"],
        own: Float[Tensor, "S G F"],
        ways: Float[Tensor, "S G K 24"] | None,
        memory: BlockMemory,
        context: TrajectoryContext,
    ) -> Float[Tensor, "S G E"]:
        edge = memory.edge if ways is None else memory.edge + self.way_in(ways)
        near = own.index_select(1, context.neighbor.flatten())
        seen = near.unflatten(1, context.neighbor.shape) + self.edge_out(
            nn.functional.relu(edge)
        )
        heads = seen.flatten(0, 1).unflatten(-1, (2, self.num_heads, -1))
        keys, values = heads.permute(2, 0, 3, 1, 4)
        exists = context.has_neighbor.expand(len(query), *(-1,) * 4).flatten(0, 1)
        # Fused kernels for GPUs take 65,535 rows only, some of them, and ours are more.
        queries = query.flatten(0, 1).unflatten(-1, (self.num_heads, 1, -1))
        weights = queries * queries.shape[-1] ** -0.5 @ keys.mT
        weights = weights.masked_fill(~exists, -torch.inf).softmax(dim=-1)
        found = weights.to(values.dtype) @ values
        return found.flatten(1).unflatten(0, query.shape[:2])
