"""Lane-anchored head: a mixture of poses proposed by the map tokens near an agent."""

from collections.abc import Sequence
from typing import Final

import torch
from jaxtyping import Complex, Float
from torch import Tensor, nn

from pd_editor.generation.initial_state.network.features import as_complex
from pd_editor.generation.initial_state.network.map_tokens import NearTokens

_NUM_PARTS: Final = 4
"""Offset and direction, both as vectors in the token's frame."""


class LaneAnchoredHead(nn.Module):
    """Weighted mean of poses that nearby map tokens propose in their own frames.

    A car's offset from its lane and its direction are simple in the frame of that lane,
    but attention averages over lanes. A car parked along a kerb is as simple in the frame
    of the kerb, for which boundary pieces propose an additional term, initially zero.
    """

    def __init__(
        self, width: int, num_features: int, *, has_boundary: bool = False
    ) -> None:
        super().__init__()
        self.from_relation = nn.Linear(num_features, width, bias=False)
        self.propose = nn.Linear(width, 1 + _NUM_PARTS)
        if has_boundary:
            self.from_boundary = nn.Linear(num_features, width, bias=False)
            self.propose_boundary = nn.Linear(width, 1 + _NUM_PARTS)
            for parameter in self.propose_boundary.parameters():
                nn.init.zeros_(parameter)

    def forward(
        self,
        agent: Float[Tensor, "B S A D"],
        relations: Sequence[Float[Tensor, "B S A _ F"]],
        near: NearTokens,
        tokens: Float[Tensor, "B S A M D"],
    ) -> Complex[Tensor, "B S A 2"]:
        """Offset and direction in the frame of the scene; 0 without a near token."""
        agent = agent[..., None, :]
        layers = [(self.from_relation, self.propose)]
        if len(relations) > 1:
            layers.append((self.from_boundary, self.propose_boundary))
        found = [
            propose(from_relation(one).add_(more).add_(agent).relu_())
            for (from_relation, propose), one, more in zip(
                layers, relations, tokens.split(near.numbers, dim=-2), strict=True
            )
        ]
        joined = found[0] if len(found) == 1 else torch.cat(found, dim=-2)
        logits, proposals = joined.float().tensor_split([1], dim=-1)
        # Each group has a mean of its own.
        weights = near.mask.weights(logits.mT).sum(dim=-2)
        proposals = as_complex(proposals.unflatten(-1, (2, 2)))
        return ((weights * near.axis)[..., None] * proposals).sum(dim=-2)
