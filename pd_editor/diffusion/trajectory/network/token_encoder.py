"""Encoder of the tokens that agents attend to, for all blocks."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.diffusion.core.attention import minus_infinity_unless
from pd_editor.diffusion.trajectory.network.block import Tokens


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
        hidden = self.embed(tokens)
        null = self.null_token.to(hidden).expand(len(hidden), 1, -1)
        hidden = torch.cat([null, hidden], dim=1)
        # The null token is always there.
        is_visible = nn.functional.pad(exists, (1, 0), value=True)
        mask = minus_infinity_unless(is_visible)[:, None].to(hidden)
        mask = mask.repeat(self.num_heads, 1, 1)
        # One product for each head, so that nothing is rearranged in memory.
        parts = (-1, hidden.shape[-1] // self.num_heads)
        weight = self.keys_values.weight.unflatten(0, parts).mT
        bias = self.keys_values.bias.unflatten(0, parts)[:, None]
        tokens_of_all = hidden.flatten(0, 1).expand(len(weight), -1, -1)
        encoded = torch.baddbmm(bias, tokens_of_all, weight)
        encoded = encoded.view(-1, 2, len(mask), *hidden.shape[1:2], parts[1])
        return [Tokens(keys, values, mask) for keys, values in encoded]
