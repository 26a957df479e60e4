"""Block of the trajectory network: attention of agents, then a feed-forward part."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.generation.core.attention import minus_infinity_unless, scale_query_rows
from pd_editor.generation.features.scene_features import LATENT_SIZE
from pd_editor.generation.trajectory.network.features import (
    NUM_WAYPOINT_FEATURES,
)


class Tokens(NamedTuple):
    """Keys and values of M tokens of G agents, for each of H heads."""

    keys: Float[Tensor, "HG M D"]
    values: Float[Tensor, "HG M D"]
    mask: Float[Tensor, "HG 1 M"]
    """Term for logits: minus infinity where there is no token."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockContext:
    """Keys, values and edges of one block; G agents of all scenes, concatenated."""

    tokens: tuple[Tokens, Tokens]
    """Map tokens and candidates."""
    boundary: Float[Tensor, "B A E"] | None
    """Encoding of the drivable area's boundary near each agent, added to its hidden
    state; None for a network without it."""
    edge: Float[Tensor, "R F"]
    """Edges to the K neighbours of all G agents, before interaction features."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Masks:
    """Masks and rows of neighbours, shared by all blocks."""

    neighbors: Float[Tensor, "B 1 A K"]
    """Term for logits: minus infinity where there is no neighbour."""
    neighbor: Int[Tensor, "B 1 A K"]


class AgentBlock(nn.Module):
    """Parallel attention to map tokens, candidates and neighbours.

    All projections are one linear layer before and one after the attentions. Edges have
    no separate keys and values: queries are compared with their embeddings, and the
    result is the weighted sum of those embeddings.

    Interaction features after those of waypoints are initialised without effect, so that
    weights of a network without them can be copied.
    """

    def __init__(
        self,
        width: int,
        num_heads: int,
        edge_width: int,
        *,
        num_interactions: int,
    ) -> None:
        super().__init__()
        self.num_heads, self.edge_width = num_heads, edge_width
        # Number of token sets with separate heads: map tokens and candidates.
        to_tokens, to_edges = 2 * width, num_heads * edge_width
        self.sizes = [to_tokens, width, to_edges, width, width]
        """Queries of tokens, neighbours and edges; keys and values for neighbours."""
        self.norm = nn.LayerNorm(width)
        self.project = nn.Linear(width, sum(self.sizes))
        scale_query_rows(self.project, to_tokens + width, width // num_heads)
        scale_query_rows(
            self.project, to_edges, edge_width, first_row=to_tokens + width
        )
        self.interaction_in = nn.Linear(num_interactions, edge_width, bias=False)
        with torch.no_grad():
            self.interaction_in.weight[:, NUM_WAYPOINT_FEATURES:] = 0
        self.attended = nn.Linear(to_tokens + to_edges + width, width)
        self.feed_forward = nn.Sequential(
            nn.LayerNorm(width),
            nn.Linear(width, 4 * width),
            nn.ReLU(),
            nn.Linear(4 * width, width),
        )
        self.output = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, LATENT_SIZE))

    def forward(
        self,
        hidden: Float[Tensor, "S B A E"],
        interactions: Float[Tensor, "S R I"] | None,
        context: BlockContext,
        masks: Masks,
    ) -> tuple[Float[Tensor, "S B A E"], Float[Tensor, "S B A 10"]]:
        """Hidden states after the block, and the output of the network at this block.

        Hidden states are of S samples of B scenes of A agents.
        """
        if context.boundary is not None:
            hidden = hidden + context.boundary
        projected = self.project(self.norm(hidden))
        to_tokens, *to_neighbors = projected.split(self.sizes, dim=-1)
        if interactions is None:
            edge = context.edge.relu()
        else:
            edge = self.interaction_in(interactions).add_(context.edge).relu_()
        seen = torch.cat(
            [
                self._attend_to_tokens(to_tokens, context.tokens),
                *self._attend_to_neighbors(to_neighbors, edge, masks),
            ],
            dim=-1,
        )
        hidden = hidden + self.attended(seen)
        hidden = hidden + self.feed_forward(hidden)
        return hidden, self.output(hidden)

    def _attend_to_neighbors(
        self, projected: list[Tensor], edge: Float[Tensor, "*S R F"], masks: Masks
    ) -> tuple[Float[Tensor, "S B A HF"], Float[Tensor, "S B A E"]]:
        """Weighted sums of edge embeddings, and of the neighbours' values."""
        shape = projected[0].shape[:3]
        num_near_agents = masks.neighbor.shape[-1]
        query, keys, values = (
            part.unflatten(-1, (self.num_heads, -1)).transpose(2, 3)
            for part in (projected[0], *projected[2:])
        )
        edge = edge.view(-1, *shape[1:], num_near_agents, self.edge_width)
        to_edges = projected[1].unflatten(-1, (self.num_heads, self.edge_width))
        of_edges = (to_edges @ edge.mT).transpose(2, 3)
        among = query @ keys.mT
        row = masks.neighbor.expand(*of_edges.shape)
        logits = among.gather(-1, row) + of_edges + masks.neighbors
        weights = logits.softmax(dim=-1).to(among.dtype)
        by_row = torch.zeros_like(among).scatter_add(-1, row, weights)
        of_neighbors = (by_row @ values).transpose(2, 3)
        seen_edges = weights.transpose(2, 3) @ edge
        return seen_edges.flatten(-2), of_neighbors.flatten(-2)

    def _attend_to_tokens(
        self, queries: Float[Tensor, "S B A QE"], sets: tuple[Tokens, Tokens]
    ) -> Float[Tensor, "S B A QE"]:
        """Weighted sums of the values of tokens, of each set."""
        samples, heads = queries.shape[0], self.num_heads
        parts = queries.flatten(1, 2).unflatten(-1, (len(sets), heads, -1))
        # All samples of an agent attend to the same tokens.
        parts = parts.permute(2, 3, 1, 0, 4).flatten(1, 2)
        found: list[Tensor] = []
        for query, tokens in zip(parts.unbind(), sets, strict=True):
            logits = torch.baddbmm(tokens.mask, query, tokens.keys.mT)
            weights = logits.softmax(dim=-1).to(tokens.values.dtype)
            found.append(torch.bmm(weights, tokens.values))
        seen = torch.stack(found).view(len(sets), heads, -1, samples, parts.shape[-1])
        return seen.permute(3, 2, 0, 1, 4).reshape(queries.shape)


class TokenEncoder(nn.Module):
    """Encodes N tokens of each of G agents, once per scene."""

    def __init__(self, size: int, width: int, num_blocks: int, num_heads: int) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.embed = nn.Sequential(
            nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()
        )
        self.null_token = nn.Parameter(torch.zeros(width))
        self.keys_values = nn.Linear(width, num_blocks * 2 * width)

    def forward(
        self, tokens: Float[Tensor, "G N F"], exists: Bool[Tensor, "G N"]
    ) -> Sequence[Tokens]:
        """Keys and values for each block; the first of the N + 1 is a null token."""
        # Existing tokens alone are encoded, after the null token, which all have.
        place = exists.flatten().cumsum(0).view_as(exists) * exists
        hidden = self.embed(tokens[exists])
        hidden = torch.cat([self.null_token.to(hidden)[None], hidden])
        mask = minus_infinity_unless(nn.functional.pad(exists, (1, 0), value=True))
        mask = mask[:, None].to(hidden).repeat(self.num_heads, 1, 1)
        # One product for each head, so that nothing is rearranged in memory.
        parts = (-1, hidden.shape[-1] // self.num_heads)
        weight = self.keys_values.weight.unflatten(0, parts).mT
        bias = self.keys_values.bias.unflatten(0, parts)[:, None]
        encoded = torch.baddbmm(bias, hidden.expand(len(weight), -1, -1), weight)
        encoded = encoded.index_select(1, nn.functional.pad(place, (1, 0)).flatten())
        encoded = encoded.view(-1, 2, *mask.shape[::2], parts[1])
        return [Tokens(keys, values, mask) for keys, values in encoded]
