"""Encoder of the tokens that agents attend to, for all blocks."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.generation.core.attention import minus_infinity_unless
from pd_editor.generation.trajectory.network.block import Tokens


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
