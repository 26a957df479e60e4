"""Layer in which map tokens attend to their neighbours, once per scene."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.generation.core.attention import EdgeAttention, Mask
from pd_editor.generation.initial_state.network.features import (
    NUM_FOLDED_FEATURES,
    NUM_PIECE_FEATURES,
    NoiseFactors,
    NoisyPoses,
    as_complex,
    noise_factors,
    piece_relations,
)
from pd_editor.generation.inputs.relative_pose import selected


class MapLayer(nn.Module):
    """Attention of each map token to its nearest neighbours, then a feed-forward part.

    It is initialised as the identity.
    """

    def __init__(
        self, width: int, edge_width: int, num_heads: int, num_neighbors: int
    ) -> None:
        super().__init__()
        self.num_neighbors = num_neighbors
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))
        num_features = NUM_PIECE_FEATURES + NUM_FOLDED_FEATURES
        self.relation_in = nn.Linear(num_features, edge_width, bias=False)
        self.token_in = nn.Linear(width, edge_width)
        self.attention = EdgeAttention(width, edge_width, num_heads)
        self.feed_forward = nn.Sequential(
            nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        for last in (self.attention.to_output, self.feed_forward[2]):
            for parameter in last.parameters():
                nn.init.zeros_(parameter)

    def forward(
        self,
        tokens: Float[Tensor, "B T D"],
        pose: Float[Tensor, "B T 3"],
        exists: Bool[Tensor, "B T"],
    ) -> Float[Tensor, "B T D"]:
        """Tokens with the context of their neighbours; arbitrary for padding."""
        num_scenes, num_tokens = exists.shape
        number = min(self.num_neighbors, num_tokens)
        distance = torch.cdist(pose[..., :2], pose[..., :2])
        distance = distance.masked_fill(~exists[:, None], math.inf)
        # A token's nearest neighbour is itself, which is left out.
        distance.diagonal(dim1=1, dim2=2).fill_(math.inf)
        nearest, index = distance.topk(number, dim=-1, largest=False, sorted=False)
        first = torch.arange(num_scenes, device=index.device) * num_tokens
        row = index + first[:, None, None]
        relations = _relations(pose, selected(pose.flatten(0, 1), row))
        normed = self.norms[0](tokens)
        of_tokens = selected(self.token_in(normed).flatten(0, 1), row)
        edges = self.relation_in(relations).add_(of_tokens).relu_()
        mask = Mask.of(nearest.isfinite()[:, :, None])
        tokens = tokens + self.attention(normed, edges, mask)
        return tokens + self.feed_forward(self.norms[1](tokens))


def _relations(
    pose: Float[Tensor, "B T 3"], others: Float[Tensor, "B T K 3"]
) -> Float[Tensor, "B T K F"]:
    """Relations of each token to its neighbours, without noise."""

    def axis(heading: Float[Tensor, "*b"]) -> Tensor:
        return torch.complex(heading.cos(), heading.sin())

    own = NoisyPoses(
        position_m=as_complex(pose[:, None, :, :2]),
        direction=axis(pose[:, None, :, 2]),
    )
    nothing = pose.new_zeros(1)
    clean: NoiseFactors = noise_factors(
        nothing, nothing, num_offsets=2, folds_turns=True
    )
    return piece_relations(
        own,
        as_complex(others[:, None, ..., :2]),
        axis(others[:, None, ..., 2]),
        clean,
        folds_turns=True,
    )[:, 0]
