"""A block of the second stage made ready for drawing: the same in fewer operations.

What two linear maps in a row do, one does, and what an edge adds to its keys and values
is taken to the query and to the result, of which there are far fewer.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import layer_norm, linear

from pd_editor.diffusion.agent_block import AgentBlock
from pd_editor.diffusion.way_points import NEAR_M

_Linear = tuple[Tensor, Tensor]
"""Weight and bias."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldedMemory:
    """What a block sees; 2 H heads: H on lane pieces, H on candidates."""

    keys: Float[Tensor, "G H2 D N"]
    values: Float[Tensor, "G H2 N D"]
    edge: Float[Tensor, "E F"]
    """Of all K neighbours of all agents in a row."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """What all blocks see alike; A agents in each of the B scenes, G in all."""

    hidden_things: Float[Tensor, "G H2 1 N"]
    """Added to logits: minus infinity where there is nothing."""
    neighbor: Int[Tensor, "V H A K"]
    """Rows within the scene, for each of V versions: S samples of B scenes."""
    hidden_neighbors: Float[Tensor, "V A 1 K"]


class FoldedBlock:
    """The weights of a block, and what it does with them."""

    def __init__(self, block: AgentBlock) -> None:
        """Weights are copied: the block may be trained on."""
        width, heads = block.width, block.num_heads
        self.num_heads, self.width = heads, width
        self.edge_width = block.way_in.out_features
        queries = _after_norm(block.norm, block.queries)
        self.queries = self._folded_queries(queries, block)
        self.attended = self._folded_result(_double(block.attended), block)
        self.sizes = [2 * width, width, heads * self.edge_width, width, width]
        norm, first, _, second = block.feed_forward
        assert isinstance(norm, nn.LayerNorm)
        assert isinstance(first, nn.Linear)
        assert isinstance(second, nn.Linear)
        self.first, self.second = _after_norm(norm, first), _double(second)
        norm, guess = block.guess
        assert isinstance(norm, nn.LayerNorm)
        assert isinstance(guess, nn.Linear)
        self.guess = _after_norm(norm, guess)
        like = block.way_in.weight
        units = [1.0, 1.0, NEAR_M]
        factors = like.new_tensor(units).repeat_interleave(like.shape[1] // 3)
        self.way_in = like * factors
        for name in ("queries", "attended", "first", "second", "guess"):
            weight, bias = getattr(self, name)
            setattr(self, name, (weight.to(like, copy=True), bias.to(like, copy=True)))

    def _folded_queries(self, queries: _Linear, block: AgentBlock) -> _Linear:
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

    def _folded_result(self, attended: _Linear, block: AgentBlock) -> _Linear:
        """Of things, of what edges add, of neighbours."""
        weight, bias = attended
        width, heads = self.width, self.num_heads
        things, near = weight.split([2 * width, width], dim=1)
        edge_values = block.edge_out.weight.double()[width:].unflatten(0, (heads, -1))
        edge = torch.einsum("whd,hdf->whf", near.unflatten(1, (heads, -1)), edge_values)
        return torch.cat([things, edge.flatten(1), near], dim=1), bias

    def __call__(
        self,
        hidden: Float[Tensor, "V A E"],
        ways: Float[Tensor, "S Z 24"] | None,
        memory: FoldedMemory,
        around: Surroundings,
    ) -> tuple[Float[Tensor, "V A E"], Float[Tensor, "V A 10"]]:
        """Hidden states after the block, and the network output guessed from them."""
        width = (self.width,)
        things, near, to_edge, keys, values = linear(
            layer_norm(hidden, width), *self.queries
        ).split(self.sizes, dim=-1)
        seen = torch.cat(
            [
                self._recalled(things, memory, around),
                *self._neighbors(near, to_edge, keys, values, ways, memory, around),
            ],
            dim=-1,
        )
        hidden = linear(seen, *self.attended).add_(hidden)
        inner = linear(layer_norm(hidden, width), *self.first).relu_()
        hidden = linear(inner, *self.second).add_(hidden)
        return hidden, linear(layer_norm(hidden, width), *self.guess)

    def _recalled(
        self,
        query: Float[Tensor, "V A HD"],
        memory: FoldedMemory,
        around: Surroundings,
    ) -> Float[Tensor, "V A HD"]:
        """What each agent remembers of pieces and candidates."""
        num_agents, heads = memory.keys.shape[:2]
        shape = query.shape
        # All samples of an agent look at the same things.
        queries = query.reshape(-1, num_agents, heads, shape[-1] // heads)
        queries = queries.permute(1, 2, 0, 3).flatten(0, 1)
        logits = torch.bmm(queries, memory.keys.flatten(0, 1))
        logits = logits.view(num_agents, heads, *logits.shape[1:])
        weights = logits.add_(around.hidden_things).softmax(dim=-1).flatten(0, 1)
        found = torch.bmm(weights, memory.values.flatten(0, 1))
        found = found.view(num_agents, heads, *found.shape[1:])
        return found.permute(2, 0, 1, 3).reshape(shape)

    def _neighbors(
        self,
        query: Float[Tensor, "V A E"],
        to_edge: Float[Tensor, "V A HF"],
        keys: Float[Tensor, "V A E"],
        values: Float[Tensor, "V A E"],
        ways: Float[Tensor, "S Z 24"] | None,
        memory: FoldedMemory,
        around: Surroundings,
    ) -> tuple[Float[Tensor, "V A HF"], Float[Tensor, "V A E"]]:
        """What each agent sees of edges, and of its neighbours themselves."""
        versions, agents = query.shape[:2]
        num_edges = versions * agents * around.neighbor.shape[-1]
        edge = self._edges(ways, memory, num_edges)
        edge = edge.view(versions * agents, -1, self.edge_width)
        to_edge = to_edge.reshape(versions * agents, self.num_heads, -1)
        among = torch.bmm(self._heads(query), self._heads(keys).mT)
        among = among.view(versions, self.num_heads, agents, agents)
        logits = torch.bmm(to_edge, edge.mT)
        logits = logits.view(versions, agents, self.num_heads, -1)
        logits = logits + among.gather(-1, around.neighbor).transpose(1, 2)
        weights = logits.add_(around.hidden_neighbors).softmax(dim=-1)
        of_edge = torch.bmm(weights.flatten(0, 1), edge)
        spread = torch.zeros_like(among)
        spread.scatter_add_(-1, around.neighbor, weights.transpose(1, 2))
        of_near = torch.bmm(spread.flatten(0, 1), self._heads(values))
        of_near = of_near.view(versions, self.num_heads, agents, -1).transpose(1, 2)
        return of_edge.view(versions, agents, -1), of_near.flatten(2)

    def _edges(
        self,
        ways: Float[Tensor, "S Z 24"] | None,
        memory: FoldedMemory,
        num_edges: int,
    ) -> Float[Tensor, "N F"]:
        """Of all versions in a row."""
        if ways is None:
            return memory.edge.relu().repeat(num_edges // len(memory.edge), 1)
        edge = linear(ways, self.way_in).add_(memory.edge).relu_()
        return edge.flatten(0, 1)

    def _heads(self, values: Float[Tensor, "V A E"]) -> Float[Tensor, "Z A D"]:
        heads = values.unflatten(-1, (self.num_heads, -1)).transpose(1, 2)
        return heads.flatten(0, 1)


def _double(layer: nn.Linear) -> _Linear:
    return layer.weight.double(), layer.bias.double()


def _after_norm(norm: nn.LayerNorm, layer: nn.Linear) -> _Linear:
    """The layer with the norm's factors and offsets, which then need not be applied."""
    weight, bias = _double(layer)
    return weight * norm.weight.double(), bias + weight @ norm.bias.double()
