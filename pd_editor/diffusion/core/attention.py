"""Attention over padded sets: what is masked counts exactly nothing."""

import math
from typing import Final, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

NORM_EPSILON: Final = 1e-5


class Mask(NamedTuple):
    """What is added to logits and multiplied with weights, so that masked is absent."""

    added: Float[Tensor, "*b #Q K"]
    """Minus infinity where a key is hidden; 0 in rows that see nothing."""
    sees_any: Bool[Tensor, "*b #Q 1"] | None
    """None where every query sees something."""

    @classmethod
    def of(cls, is_visible: Bool[Tensor, "*b #Q K"]) -> "Mask":
        """The mask that leaves some keys visible to each query."""
        sees_any = is_visible.any(dim=-1, keepdim=True)
        # Blind rows stay finite, so that no gradient becomes NaN.
        hidden = ~is_visible & sees_any
        added = torch.zeros(hidden.shape, device=hidden.device)
        added = added.masked_fill_(hidden, -math.inf)
        return cls(added, None if bool(sees_any.all()) else sees_any)

    def repeated(self, num: int) -> "Mask":
        """Each of the masks several times in a row."""
        if num == 1:
            return self
        sees_any = self.sees_any
        if sees_any is not None:
            sees_any = sees_any.repeat_interleave(num, 0)
        return Mask(self.added.repeat_interleave(num, 0), sees_any)


def attention_weights(
    logits: Float[Tensor, "*b Q K"], mask: Mask
) -> Float[Tensor, "*b Q K"]:
    """Softmax over the visible keys; all 0 where a query sees none."""
    weights = (logits + mask.added).softmax(dim=-1)
    return weights if mask.sees_any is None else weights * mask.sees_any


class KeysValues(NamedTuple):
    """Keys and values of B sets of K tokens, for H maps of weights."""

    keys: Float[Tensor, "B H K C"]
    values: Float[Tensor, "B H K C"]
    share: Float[Tensor, ""]
    """How much of each second map is taken off."""
    mask: Mask


class DifferentialAttention(nn.Module):
    """Attention whose weights are the difference of two softmaxes.

    Both maps of a head have the head's full width. ``is_differential`` false makes it
    plain multi-head attention, for comparison.

    Source: Ye et al., Differential Transformer, 2024.
    """

    def __init__(
        self, width: int, num_heads: int, *, depth: int, is_differential: bool = True
    ) -> None:
        super().__init__()
        assert width % num_heads == 0
        self.num_heads = num_heads
        self.num_maps = 2 if is_differential else 1
        self.to_queries = nn.Linear(width, self.num_maps * width, bias=False)
        self.to_keys = nn.Linear(width, self.num_maps * width, bias=False)
        self.to_values = nn.Linear(width, width, bias=False)
        self.to_output = nn.Linear(width, width, bias=False)
        self.initial_share = 0.8 - 0.6 * math.exp(-0.3 * depth)
        if is_differential:
            channels = width // num_heads
            self.share_vectors = nn.Parameter(torch.randn(4, channels) * 0.1)
            self.norm_weight = nn.Parameter(torch.ones(channels))

    def keys_values(self, tokens: Float[Tensor, "B K D"], mask: Mask) -> KeysValues:
        """What does not depend on the queries; the mask is of shape [B 1 1 K]."""
        values = self._split(self.to_values(tokens), self.num_heads)
        return KeysValues(
            keys=self._split(self.to_keys(tokens), self.num_heads * self.num_maps),
            values=values.repeat_interleave(self.num_maps, 1),
            share=self.share(),
            mask=mask,
        )

    def forward(
        self, tokens: Float[Tensor, "B Q D"], seen: KeysValues
    ) -> Float[Tensor, "B Q D"]:
        """Attend from Q tokens to a set."""
        queries = self._split(self.to_queries(tokens), self.num_heads * self.num_maps)
        parts = (queries, seen.keys, seen.values)
        if tokens.device.type == "cpu":
            # Its slope in bfloat16 takes three times as long there.
            parts = tuple(part.float() for part in parts)
        with torch.autocast(tokens.device.type, enabled=False):
            result = nn.functional.scaled_dot_product_attention(
                *parts, attn_mask=seen.mask.added.to(parts[0].dtype)
            )
        if self.num_maps == 2:
            # The difference of weights on the same values is that of the results.
            one, two = result.unflatten(1, (self.num_heads, 2)).unbind(2)
            result = self._normed((one - seen.share * two).float())
        if seen.mask.sees_any is not None:
            result = result * seen.mask.sees_any
        return self.to_output(result.transpose(1, 2).flatten(2))

    def share(self) -> Float[Tensor, ""]:
        """How much of the second softmax is taken off; 0 for plain attention."""
        if self.num_maps == 1:
            return self.to_keys.weight.new_zeros(())
        one, two, three, four = self.share_vectors
        difference = (one * two).sum().exp() - (three * four).sum().exp()
        return difference + self.initial_share

    def _normed(self, values: Float[Tensor, "B H Q C"]) -> Float[Tensor, "B H Q C"]:
        """Each head at root mean square one, times what the first share leaves."""
        size = values.square().mean(dim=-1, keepdim=True) + NORM_EPSILON
        return values * size.rsqrt() * (self.norm_weight * (1 - self.initial_share))

    def _split(
        self, values: Float[Tensor, "B K D"], num_parts: int
    ) -> Float[Tensor, "B N K C"]:
        return values.unflatten(-1, (num_parts, -1)).transpose(1, 2)


class NeighborAttention(nn.Module):
    """Attention from each token to neighbours given by embeddings of the relation.

    Keys and values are the embeddings themselves, so nothing has to be gathered;
    with ``with_tokens`` the neighbours' own tokens count as well.
    """

    def __init__(
        self, width: int, relation_width: int, num_heads: int, *, with_tokens: bool
    ) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.to_queries = nn.Linear(width, num_heads * relation_width, bias=False)
        self.to_output = nn.Linear(num_heads * relation_width, width, bias=False)
        self.scale = relation_width**-0.5
        self.with_tokens = with_tokens
        if with_tokens:
            self.to_token_parts = nn.Linear(width, 3 * width, bias=False)
            self.from_values = nn.Linear(width, width, bias=False)

    def forward(
        self,
        tokens: Float[Tensor, "N A D"],
        relations: Float[Tensor, "N A M R"],
        mask: Mask,
    ) -> Float[Tensor, "N A D"]:
        """Attend from A tokens to M neighbours each; to all A with ``with_tokens``.

        The mask is of shape [N A 1 M].
        """
        queries = self.to_queries(tokens).unflatten(-1, (self.num_heads, -1))
        logits = (queries * self.scale) @ relations.transpose(-1, -2)
        if self.with_tokens:
            queries, keys, values = (
                part.unflatten(-1, (self.num_heads, -1)).transpose(1, 2)
                for part in self.to_token_parts(tokens).chunk(3, dim=-1)
            )
            scale = queries.shape[-1] ** -0.5
            among = (queries * scale) @ keys.transpose(-1, -2)
            logits = logits + among.transpose(1, 2)
            weights = attention_weights(logits, mask)
            taken = weights.transpose(1, 2).to(values.dtype) @ values
            result = self.from_values(taken.transpose(1, 2).flatten(2))
        else:
            weights = attention_weights(logits, mask)
            result = tokens.new_zeros(())
        seen = weights.to(relations.dtype) @ relations
        return result + self.to_output(seen.flatten(2))


def visible_agents(
    has_agent: Bool[Tensor, "B A"], is_central: Bool[Tensor, "B"]
) -> Bool[Tensor, "B A A"]:
    """Whom each agent sees: all others, or nobody in a decentralised scene.

    The paper's Bernoulli mask, with real isolation.
    """
    num_agents = has_agent.shape[1]
    others = ~torch.eye(num_agents, dtype=torch.bool, device=has_agent.device)
    return others & has_agent[:, None, :] & is_central[:, None, None]
