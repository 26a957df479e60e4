"""A layer of the first stage made ready for drawing: the same in fewer operations.

What two linear maps in a row do, one does: relations are left as the hidden layer that
embeds them, and the second half of the embedding is taken to queries and results.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import gelu, rms_norm

from pd_editor.diffusion.core.attention import (
    NORM_EPSILON,
    KeysValues,
    NeighborAttention,
)
from pd_editor.diffusion.fused.folded_layers import Affine, Norm, linear_layers
from pd_editor.diffusion.initial_state.denoiser import PoseLayer


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadSeen:
    """What a layer sees of all pieces of the road of B scenes, with H maps."""

    keys: Float[Tensor, "BH C P"]
    values: Float[Tensor, "BH P C"]
    hidden: Float[Tensor, "B 1 1 P"] | None
    """Added to logits; None where no piece is missing."""
    exists: Float[Tensor, "B 1 1"] | None
    """0 where a scene has no piece at all; None where all have."""

    @classmethod
    def of(cls, seen: KeysValues, is_differential: bool) -> "RoadSeen":
        """The share of each second map is taken off already."""
        values = seen.values
        if is_differential:
            factor = torch.stack([torch.ones_like(seen.share), -seen.share])
            values = values.unflatten(1, (-1, 2)) * factor[:, None, None]
            values = values.flatten(1, 2)
        added, sees_any = seen.mask
        return cls(
            keys=seen.keys.transpose(-1, -2).flatten(0, 1).contiguous(),
            values=values.flatten(0, 1).contiguous(),
            hidden=added if bool(added.any()) else None,
            exists=None if sees_any is None else sees_any[:, 0].to(values),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Around:
    """What is near Z agents of V versions, the same in all layers."""

    pieces: Float[Tensor, "Z M R"]
    """Hidden layers of relations to pieces of the road."""
    hidden_pieces: Float[Tensor, "Z 1 M"] | None
    others: Float[Tensor, "Z A R"]
    """The same to all agents."""
    hidden_others: Float[Tensor, "V 1 A A"]
    sees_pieces: Float[Tensor, "Z 1"] | None
    """0 for those without a piece; None where all have."""
    sees_others: Float[Tensor, "Z 1"] | None


class FoldedPoseLayer:
    """The weights of a layer, and what it does with them."""

    def __init__(
        self, layer: PoseLayer, of_pieces: nn.Linear, of_others: nn.Linear
    ) -> None:
        """Weights are copied; ``of_pieces`` and ``of_others`` end the embeddings."""
        self._norms = [Norm(one) for one in layer.norms]
        road, others = layer.map_attention, layer.agent_attention
        self._num_heads, self._num_maps = road.num_heads, road.num_maps
        width = road.to_output.in_features
        scale = (width // road.num_heads) ** -0.5
        self._road_queries = _transposed(road.to_queries.weight * scale)
        result = road.to_output.weight
        if road.num_maps == 2:
            factor = road.norm_weight * (1 - road.initial_share)
            result = result * factor.repeat(road.num_heads)
        self._road_result = _transposed(result)
        queries, self._near_result, self._near_shift = _folded(
            layer.piece_attention, of_pieces
        )
        self._near_queries = _transposed(queries)
        queries, seen, self._others_shift = _folded(others, of_others)
        parts = others.to_token_parts.weight.clone()
        parts[:width] *= scale
        self._others_queries = _transposed(torch.cat([queries, parts]))
        self._others_result = torch.cat([seen, _transposed(others.from_values.weight)])
        self._others_sizes = [len(queries), width, width, width]
        first, second = linear_layers(layer.think)
        like = first.weight
        self._first = Affine((first.weight, first.bias), like)
        self._second = Affine((second.weight, second.bias), like)

    def __call__(
        self, token: Float[Tensor, "Z D"], road: RoadSeen, around: Around
    ) -> Float[Tensor, "Z D"]:
        """Tokens after the layer."""
        norms = self._norms
        token = torch.addmm(
            token, self._of_road(norms[0](token), road), self._road_result
        )
        token.addmm_(self._of_pieces(norms[1](token), around), self._near_result)
        token.add_(_unless_blind(self._near_shift, around.sees_pieces))
        token.addmm_(self._of_others(norms[2](token), around), self._others_result)
        token.add_(_unless_blind(self._others_shift, around.sees_others))
        inner = gelu(self._first(norms[3](token)))
        return self._second(inner).add_(token)

    def _of_road(
        self, token: Float[Tensor, "Z D"], road: RoadSeen
    ) -> Float[Tensor, "Z D"]:
        num_maps = self._num_heads * self._num_maps
        num_scenes = len(road.keys) // num_maps
        queries = (token @ self._road_queries).view(
            num_scenes, -1, num_maps, road.keys.shape[1]
        )
        logits = torch.bmm(queries.transpose(1, 2).flatten(0, 1), road.keys)
        if road.hidden is not None:
            logits.view(num_scenes, num_maps, *logits.shape[1:]).add_(road.hidden)
        found = torch.bmm(logits.softmax(dim=-1), road.values)
        found = found.view(
            num_scenes, self._num_heads, self._num_maps, *found.shape[1:]
        )
        found = found.sum(dim=2)
        if self._num_maps == 2:
            found = rms_norm(found, found.shape[-1:], eps=NORM_EPSILON)
        found = found.transpose(1, 2).flatten(2)
        if road.exists is not None:
            found = found * road.exists
        return found.flatten(0, 1)

    def _of_pieces(
        self, token: Float[Tensor, "Z D"], around: Around
    ) -> Float[Tensor, "Z HR"]:
        queries = (token @ self._near_queries).view(len(token), self._num_heads, -1)
        logits = torch.bmm(queries, around.pieces.mT)
        if around.hidden_pieces is not None:
            logits.add_(around.hidden_pieces)
        found = torch.bmm(logits.softmax(dim=-1), around.pieces).flatten(1)
        return _unless_blind(found, around.sees_pieces)

    def _of_others(
        self, token: Float[Tensor, "Z D"], around: Around
    ) -> Float[Tensor, "Z HR_D"]:
        heads = self._num_heads
        versions, _, agents, _ = around.hidden_others.shape
        split = (token @ self._others_queries).split(self._others_sizes, dim=-1)
        to_relations = split[0].reshape(len(token), heads, -1)
        query, key, value = (
            part.view(versions, agents, heads, -1).transpose(1, 2).flatten(0, 1)
            for part in split[1:]
        )
        logits = torch.bmm(query, key.mT).view(versions, heads, agents, agents)
        related = torch.bmm(to_relations, around.others.mT)
        logits += related.view(versions, agents, heads, agents).transpose(1, 2)
        weights = logits.add_(around.hidden_others).softmax(dim=-1)
        taken = torch.bmm(weights.flatten(0, 1), value)
        taken = taken.view(versions, heads, agents, -1).transpose(1, 2)
        by_agent = weights.transpose(1, 2).reshape(len(token), heads, agents)
        seen = torch.bmm(by_agent, around.others)
        found = torch.cat([seen.flatten(1), taken.reshape(len(token), -1)], dim=-1)
        return _unless_blind(found, around.sees_others)


def _unless_blind(
    values: Float[Tensor, "*#Z F"], sees_any: Float[Tensor, "Z 1"] | None
) -> Float[Tensor, "*Z F"]:
    """Nothing for those who see nothing."""
    return values if sees_any is None else values * sees_any


def _folded(
    attention: NeighborAttention, last: nn.Linear
) -> tuple[Float[Tensor, "HR D"], Float[Tensor, "HR D"], Float[Tensor, "D"]]:
    """Queries, results and their shift, for relations without their last layer.

    What its bias adds to logits is the same for all neighbours, and counts nothing.
    """
    heads = attention.num_heads
    weight, bias = last.weight.double(), last.bias.double()
    queries = attention.to_queries.weight.double().unflatten(0, (heads, -1))
    queries = torch.einsum("rs,hrd->hsd", weight, queries) * attention.scale
    result = attention.to_output.weight.double().unflatten(1, (heads, -1))
    shift = torch.einsum("dhr,r->d", result, bias)
    result = torch.einsum("dhr,rs->hsd", result, weight)
    like = attention.to_queries.weight
    return (
        queries.flatten(0, 1).to(like),
        result.flatten(0, 1).to(like),
        shift.to(like),
    )


def _transposed(weight: Float[Tensor, "O I"]) -> Float[Tensor, "I O"]:
    """As it is multiplied fastest; a copy."""
    return weight.t().clone(memory_format=torch.contiguous_format)
