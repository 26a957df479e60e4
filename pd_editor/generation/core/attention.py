"""Attention over padded sets: a masked key has a weight of exactly 0."""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.generation.core.devices import constant, is_known

_NORM_EPSILON: Final = 1e-5
_VECTOR_LENGTH: Final = 16


class Mask(NamedTuple):
    """Attention mask: a term for logits, and a factor for results."""

    added: Float[Tensor, "*b #Q K"] | None
    """Minus infinity where a key is masked, 0 in rows without a visible key; None if no
    key is masked."""
    sees_any: Float[Tensor, "*b #Q 1"] | None
    """0 for queries without a visible key; None if every query has one."""

    @classmethod
    def of(cls, is_visible: Bool[Tensor, "*b #Q K"]) -> "Mask":
        """Make the mask from the visible keys of each query."""
        if is_known(is_visible.all()):
            return cls(None, None)
        sees_any = is_visible.any(dim=-1, keepdim=True)
        # Rows without a visible key stay finite, so that no gradient becomes NaN.
        added = minus_infinity_unless(is_visible | ~sees_any)
        return cls(added, None if is_known(sees_any.all()) else sees_any.to(added))

    def weights(self, logits: Float[Tensor, "*b #Q K"]) -> Float[Tensor, "*b Q K"]:
        """Softmax over the visible keys; all 0 for queries without one."""
        if self.added is not None:
            logits = logits + self.added
        weights = softmax(logits)
        return weights if self.sees_any is None else weights * self.sees_any

    def mapped(self, change: Callable[[Tensor], Tensor]) -> "Mask":
        """Apply a change of shape to both parts."""
        return Mask(*(None if one is None else change(one) for one in self))


def grouped(masks: Sequence[Mask], numbers: Sequence[int], like: Tensor) -> Mask:
    """One mask [*b G M] of G groups of keys side by side: row g sees those of group g.

    ``masks`` [*b 1 K] and ``numbers`` are of the keys of each group.
    """
    if len(masks) == 1:
        return masks[0]
    own = _own_group(numbers, like)
    if all(one.added is None for one in masks):
        return Mask(own, None)
    shape = next(one.added.shape for one in masks if one.added is not None)[:-1]
    added = [
        like.new_zeros((*shape, number)) if one.added is None else one.added
        for one, number in zip(masks, numbers, strict=True)
    ]
    sees_any = None
    if any(one.sees_any is not None for one in masks):
        ones = like.new_ones((*shape, 1))
        rows = [ones if one.sees_any is None else one.sees_any for one in masks]
        sees_any = torch.cat(rows, dim=-2)
    return Mask(torch.cat(added, dim=-1) + own, sees_any)


def _own_group(numbers: Sequence[int], like: Tensor) -> Float[Tensor, "1 1 1 G M"]:
    """0 where a key is of the row's group, else minus infinity."""
    group = [index for index, number in enumerate(numbers) for _ in range(number)]
    rows = [
        [0.0 if one == own else -math.inf for one in group]
        for own in range(len(numbers))
    ]
    return constant(rows, like)[None, None, None]


def softmax(logits: Float[Tensor, "*b K"]) -> Float[Tensor, "*b K"]:
    """Softmax over the last axis, whose torch version is vectorised for 16 keys or more."""
    num_keys = logits.shape[-1]
    if num_keys >= _VECTOR_LENGTH:
        return logits.softmax(dim=-1)
    filled = nn.functional.pad(logits, (0, _VECTOR_LENGTH - num_keys), value=-math.inf)
    return filled.softmax(dim=-1)[..., :num_keys]


def minus_infinity_unless(exists: Bool[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Term for logits: 0 where something exists, minus infinity elsewhere."""
    added = torch.zeros(exists.shape, device=exists.device)
    return added.masked_fill_(~exists, -math.inf)


def scale_query_rows(
    layer: nn.Linear, num_rows: int, channels: int, *, first_row: int = 0
) -> None:
    """Scale initial query weights of D channels by 1 / sqrt(D).

    The factor is part of the weights, not a separate operation.
    """
    rows = slice(first_row, first_row + num_rows)
    with torch.no_grad():
        layer.weight[rows] *= channels**-0.5
        if layer.bias is not None:
            layer.bias[rows] *= channels**-0.5


class KeysValues(NamedTuple):
    """Keys and values of B sets of K tokens, for H heads with N maps each."""

    keys: Float[Tensor, "BHN C K"]
    values: Float[Tensor, "BH K C"]
    mask: Mask
    """Mask of shape [B 1 1 K]."""
    second_share: Float[Tensor, ""] | None
    """Of the weights of second maps in the sum of both: minus lambda."""


class DifferentialAttention(nn.Module):
    """Attention whose weights are the difference of two softmaxes.

    Both maps of a head have the head's full width. ``is_differential`` false makes it
    plain multi-head attention, for comparison.

    Source: Ye et al., Differential Transformer, 2024. The weights of its norm are part
    of the output layer.
    """

    def __init__(
        self, width: int, num_heads: int, *, depth: int, is_differential: bool = True
    ) -> None:
        super().__init__()
        assert width % num_heads == 0
        channels = width // num_heads
        self.num_heads = num_heads
        self.num_maps = 2 if is_differential else 1
        num_rows = self.num_maps * width
        self.to_queries = nn.Linear(width, num_rows, bias=False)
        scale_query_rows(self.to_queries, num_rows, channels)
        self.to_keys = nn.Linear(width, num_rows, bias=False)
        self.to_values = nn.Linear(width, width, bias=False)
        self.to_output = nn.Linear(width, width, bias=False)
        self.initial_lambda = initial_lambda(depth)
        if is_differential:
            self.lambda_vectors = nn.Parameter(
                nn.init.normal_(torch.empty(4, channels), std=0.1)
            )
            with torch.no_grad():
                self.to_output.weight *= 1 - self.initial_lambda

    def encode(self, tokens: Float[Tensor, "B K D"], mask: Mask) -> KeysValues:
        """Keys and values, which do not depend on queries; the mask has shape [B 1 1 K]."""
        keys = self.to_keys(tokens).unflatten(-1, (self.num_heads * self.num_maps, -1))
        values = self.to_values(tokens).unflatten(-1, (self.num_heads, -1))
        return KeysValues(
            keys=keys.transpose(1, 2).flatten(0, 1).contiguous().mT,
            values=values.transpose(1, 2).flatten(0, 1).contiguous(),
            mask=mask,
            second_share=-self.lambda_() if self.num_maps == 2 else None,
        )

    def forward(
        self, tokens: Float[Tensor, "B Q D"], seen: KeysValues
    ) -> Float[Tensor, "B Q D"]:
        """Attend from Q tokens to a set."""
        weights = self.scores(tokens, seen)
        found = torch.bmm(weights.flatten(0, 1), seen.values)
        if self.num_maps == 2:
            found = _normed(found.float()).to(found.dtype)
        found = found.view(*weights.shape[:3], -1)
        return self.to_output(found.transpose(1, 2).flatten(2))

    def scores(
        self, tokens: Float[Tensor, "B Q D"], seen: KeysValues
    ) -> Float[Tensor, "B H Q K"]:
        """Weights of the K tokens of the set."""
        num_rows = self.num_heads * self.num_maps
        queries = self.to_queries(tokens).unflatten(-1, (num_rows, -1)).transpose(1, 2)
        logits = torch.bmm(queries.flatten(0, 1), seen.keys)
        weights = seen.mask.weights(logits.unflatten(0, (-1, num_rows)))
        if seen.second_share is not None:
            first, second = weights.unflatten(1, (self.num_heads, 2)).unbind(2)
            weights = torch.addcmul(first, seen.second_share, second)
        return weights

    def lambda_(self) -> Float[Tensor, ""]:
        """Weight of the second softmax."""
        one, two, three, four = self.lambda_vectors
        difference = (one * two).sum().exp() - (three * four).sum().exp()
        return difference + self.initial_lambda


def _normed(values: Float[Tensor, "*b C"]) -> Float[Tensor, "*b C"]:
    """Vectors with a root mean square of one; faster than torch's function."""
    length = torch.linalg.vector_norm(values, dim=-1, keepdim=True)
    return values * (length.square() / values.shape[-1] + _NORM_EPSILON).rsqrt()


def initial_lambda(depth: int) -> float:
    """Initial weight of the second softmax of a layer at some depth."""
    return 0.8 - 0.6 * math.exp(-0.3 * depth)


class EdgeAttention(nn.Module):
    """Attention of each token over its edges, whose embeddings are keys and values.

    With ``with_tokens`` the tokens at the other ends count as well: then every token
    has an edge to every other one. Edges of several groups have heads of their own, as
    many for each group; at first only those of the first group count.
    """

    def __init__(
        self,
        width: int,
        edge_width: int,
        num_heads: int,
        *,
        with_tokens: bool = False,
        num_groups: int = 1,
    ) -> None:
        super().__init__()
        assert not (with_tokens and num_groups > 1)
        self.num_heads, self.num_groups = num_heads, num_groups
        to_edges = num_heads * edge_width
        self.sizes = [to_edges * num_groups, *[3 * width] * with_tokens]
        """Queries of edges; queries, keys and values of tokens together."""
        self.project = nn.Linear(width, sum(self.sizes), bias=False)
        scale_query_rows(self.project, self.sizes[0], edge_width)
        if with_tokens:
            scale_query_rows(
                self.project, width, width // num_heads, first_row=to_edges
            )
        self.to_output = nn.Linear(self.sizes[0] + width * with_tokens, width)
        if num_groups > 1:
            with torch.no_grad():
                self.to_output.weight[:, to_edges:] = 0.0

    def forward(
        self,
        tokens: Float[Tensor, "N A D"],
        edges: Float[Tensor, "N A M R"],
        mask: Mask,
    ) -> Float[Tensor, "N A D"]:
        """Attend along M edges of each of A tokens.

        The mask is of shape [N A 1 M], or has a row for each head. The result is 0 for
        a token without an edge, if there is one group only.
        """
        weights, values = self.scores(tokens, edges, mask)
        seen = torch.bmm(weights.flatten(0, 1), edges.flatten(0, 1))
        seen = seen.view(*tokens.shape[:2], -1)
        if values is not None:
            of_tokens = torch.bmm(weights.transpose(1, 2).flatten(0, 1), values)
            of_tokens = of_tokens.unflatten(0, (-1, self.num_heads)).transpose(1, 2)
            seen = torch.cat([seen, of_tokens.flatten(2)], dim=-1)
        found = self.to_output(seen)
        if self.num_groups > 1 or mask.sees_any is None:
            return found
        return found * mask.sees_any[:, :, 0]

    def scores(
        self,
        tokens: Float[Tensor, "N A D"],
        edges: Float[Tensor, "N A M R"],
        mask: Mask,
    ) -> tuple[Float[Tensor, "N A H M"], Float[Tensor, "NH A C"] | None]:
        """Weights of edges, and the values of tokens if they count."""
        to_edges, *to_tokens = self.project(tokens).split(self.sizes, dim=-1)
        num_rows = self.num_groups * self.num_heads
        queries = to_edges.reshape(-1, num_rows, edges.shape[-1])
        added = tokens.new_zeros((1,) * 4) if mask.added is None else mask.added
        values = None
        if to_tokens:
            parts = to_tokens[0].unflatten(-1, (3, self.num_heads, -1))
            parts = parts.permute(2, 0, 3, 1, 4).flatten(1, 2)
            query, keys, values = parts.unbind()
            among = torch.bmm(query, keys.mT).unflatten(0, (-1, self.num_heads))
            added = among.transpose(1, 2) + added
        logits = torch.baddbmm(added.flatten(0, 1), queries, edges.flatten(0, 1).mT)
        logits = logits.view(*tokens.shape[:2], num_rows, -1)
        return mask._replace(added=None).weights(logits), values


def visible_agents(
    has_agent: Bool[Tensor, "B A"], is_central: Bool[Tensor, "B"]
) -> Bool[Tensor, "B A A"]:
    """Agents that each agent attends to: all others, or none in a decentralised scene.

    This is the paper's Bernoulli mask, with complete isolation.
    """
    num_agents = has_agent.shape[1]
    others = ~torch.eye(num_agents, dtype=torch.bool, device=has_agent.device)
    return others & has_agent[:, None, :] & is_central[:, None, None]
