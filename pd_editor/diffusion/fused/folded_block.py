"""A block of the second stage made ready for drawing: the same in fewer operations.

What two linear maps in a row do, one does, and what an edge adds to its keys and values
is taken to the query and to the result, of which there are far fewer.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from pd_editor.diffusion.fused.folded_layers import Affine, Linear, Norm, linear_layers
from pd_editor.diffusion.trajectory.block import AgentBlock
from pd_editor.diffusion.trajectory.interaction_features import NEAR_M


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockSurroundings:
    """What one block sees of the things and neighbours of G agents."""

    keys: Float[Tensor, "G H2 D M"]
    values: Float[Tensor, "G H2 M D"]
    edge: Float[Tensor, "E F"]
    """Of all K neighbours of all agents in a row."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """What all blocks see alike, of V versions: S samples of B scenes of A agents."""

    hidden_things: Float[Tensor, "G H2 1 M"]
    """Added to logits: minus infinity where there is nothing."""
    num_neighbors: int
    """K, the agent itself counted."""
    neighbor: Int[Tensor, "V H A W"]
    """Rows within the scene, filled up to a width W at which a softmax is fast."""
    hidden_neighbors: Float[Tensor, "V 1 A W"]


class FoldedBlock:
    """The weights of a block, and what it does with them."""

    def __init__(self, block: AgentBlock) -> None:
        """Weights are copied: the block may be trained on."""
        width, heads = block.width, block.num_heads
        self.num_heads, self.width = heads, width
        self.edge_width = block.way_in.out_features
        like = block.queries.weight
        queries = self._folded_queries(_double(block.queries), block)
        self.queries = Affine(queries, like)
        result = self._folded_result(_double(block.attended), block)
        self.attended = Affine(result, like)
        self.sizes = [2 * width, width, heads * self.edge_width, width, width]
        first, second = linear_layers(block.feed_forward)
        (guess,) = linear_layers(block.guess)
        self.first = Affine(_double(first), like)
        self.second = Affine(_double(second), like)
        self.guess = Affine(_double(guess), like)
        norms = (block.norm, block.feed_forward[0], block.guess[0])
        self.norms = [Norm(one) for one in norms]
        factors = like.new_tensor([1.0, 1.0, NEAR_M])
        factors = factors.repeat_interleave(block.way_in.in_features // 3)
        self.way_in = (block.way_in.weight * factors).t().contiguous()

    def _folded_queries(self, queries: Linear, block: AgentBlock) -> Linear:
        """To things, to neighbours, to what edges add; own keys and values."""
        weight, bias = queries
        width, heads = self.width, self.num_heads
        scale = (width // heads) ** -0.5
        things, near, own = weight.split([2 * width, width, 2 * width])
        to_things, to_near, of_own = bias.split([2 * width, width, 2 * width])
        edge_keys = block.edge_out.weight.double()[:width].unflatten(0, (heads, -1))
        edge = torch.einsum("hdf,hdw->hfw", edge_keys, near.unflatten(0, (heads, -1)))
        to_edge = torch.einsum(
            "hdf,hd->hf", edge_keys, to_near.unflatten(0, (heads, -1))
        )
        return (
            torch.cat([things * scale, near * scale, edge.flatten(0, 1) * scale, own]),
            torch.cat(
                [to_things * scale, to_near * scale, to_edge.flatten() * scale, of_own]
            ),
        )

    def _folded_result(self, attended: Linear, block: AgentBlock) -> Linear:
        """Of things, of what edges add, of neighbours."""
        weight, bias = attended
        width, heads = self.width, self.num_heads
        things, near = weight.split([2 * width, width], dim=1)
        edge_values = block.edge_out.weight.double()[width:].unflatten(0, (heads, -1))
        edge = torch.einsum("whd,hdf->whf", near.unflatten(1, (heads, -1)), edge_values)
        return torch.cat([things, edge.flatten(1), near], dim=1), bias

    def __call__(
        self,
        hidden: Float[Tensor, "Z E"],
        ways: Float[Tensor, "N 24"] | None,
        memory: BlockSurroundings,
        around: Surroundings,
    ) -> tuple[Float[Tensor, "Z E"], Float[Tensor, "Z 10"]]:
        """Hidden states after the block, and the network output guessed from them.

        Z are the A agents of V versions, N their neighbours.
        """
        before, between, after = self.norms
        queries = self.queries(before(hidden))
        things, near, to_edge, keys, values = queries.split(self.sizes, dim=-1)
        seen = torch.cat(
            [
                self._recalled(things, memory, around),
                *self._neighbors(near, to_edge, keys, values, ways, memory, around),
            ],
            dim=-1,
        )
        hidden = self.attended(seen).add_(hidden)
        inner = self.first(between(hidden)).relu_()
        hidden = self.second(inner).add_(hidden)
        return hidden, self.guess(after(hidden))

    def _recalled(
        self,
        query: Float[Tensor, "Z E2"],
        memory: BlockSurroundings,
        around: Surroundings,
    ) -> Float[Tensor, "Z E2"]:
        """What each agent remembers of pieces and candidates."""
        num_agents, heads = memory.keys.shape[:2]
        # All samples of an agent look at the same things.
        queries = query.unflatten(0, (-1, num_agents)).unflatten(-1, (heads, -1))
        queries = queries.permute(1, 2, 0, 3).flatten(0, 1)
        logits = torch.bmm(queries, memory.keys.flatten(0, 1))
        logits = logits.view(num_agents, heads, *logits.shape[1:])
        weights = logits.add_(around.hidden_things).softmax(dim=-1).flatten(0, 1)
        found = torch.bmm(weights, memory.values.flatten(0, 1))
        found = found.view(num_agents, heads, *found.shape[1:])
        return found.permute(2, 0, 1, 3).reshape(query.shape)

    def _neighbors(
        self,
        query: Float[Tensor, "Z E"],
        to_edge: Float[Tensor, "Z HF"],
        keys: Float[Tensor, "Z E"],
        values: Float[Tensor, "Z E"],
        ways: Float[Tensor, "N 24"] | None,
        memory: BlockSurroundings,
        around: Surroundings,
    ) -> tuple[Float[Tensor, "Z HF"], Float[Tensor, "Z E"]]:
        """What each agent sees of edges, and of its neighbours themselves."""
        versions, heads, agents = around.neighbor.shape[:3]
        number = around.num_neighbors
        edge = self._edges(ways, memory, len(query) * number)
        edge = edge.view(len(query), number, self.edge_width)
        shape = (versions, agents, heads, -1)
        by_head = [
            part.view(shape).transpose(1, 2).flatten(0, 1)
            for part in (query, keys, values)
        ]
        among = torch.bmm(by_head[0], by_head[1].mT)
        among = among.view(versions, heads, agents, agents)
        of_edges = torch.bmm(to_edge.view(len(query), heads, -1), edge.mT)
        of_edges = of_edges.view(versions, agents, heads, number)
        logits = among.gather(-1, around.neighbor).add_(around.hidden_neighbors)
        logits[..., :number] += of_edges.transpose(1, 2)
        weights = logits.softmax(dim=-1)
        spread = torch.zeros_like(among).scatter_add_(-1, around.neighbor, weights)
        of_near = torch.bmm(spread.flatten(0, 1), by_head[2])
        of_near = of_near.view(versions, heads, agents, -1).transpose(1, 2)
        weights = weights[..., :number].transpose(1, 2).flatten(0, 1)
        of_edge = torch.bmm(weights, edge)
        return of_edge.flatten(1), of_near.reshape(query.shape)

    def _edges(
        self,
        ways: Float[Tensor, "N 24"] | None,
        memory: BlockSurroundings,
        num_edges: int,
    ) -> Float[Tensor, "N F"]:
        """Of all versions in a row."""
        if ways is None:
            return memory.edge.relu().repeat(num_edges // len(memory.edge), 1)
        edge = ways @ self.way_in
        edge.view(-1, *memory.edge.shape).add_(memory.edge)
        return edge.relu_()


def _double(layer: nn.Linear) -> Linear:
    return layer.weight.double(), layer.bias.double()
