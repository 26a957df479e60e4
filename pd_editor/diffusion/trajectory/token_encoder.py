"""Keys and values of the tokens that agents attend to, for all blocks at once."""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class TokenEncoder(nn.Module):
    """Encodes N tokens of each of G agents, once per scene."""

    def __init__(self, size: int, width: int, num_blocks: int, num_heads: int) -> None:
        super().__init__()
        self.shape = (num_blocks, 2, num_heads, -1)
        self.embed = nn.Sequential(
            nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()
        )
        self.null_token = nn.Parameter(torch.zeros(width))
        self.keys_values = nn.Linear(width, num_blocks * 2 * width)

    def forward(
        self, tokens: Float[Tensor, "G N F"]
    ) -> tuple[Float[Tensor, "L G H D M"], Float[Tensor, "L G H M D"]]:
        """Keys and values for L blocks; the first of the M = N + 1 is a null token."""
        hidden = self.embed(tokens)
        null = self.null_token.to(hidden).expand(len(hidden), 1, -1)
        encoded = self.keys_values(torch.cat([null, hidden], dim=1))
        table = encoded.unflatten(-1, self.shape)
        keys, values = table.unbind(-3)
        return keys.permute(2, 0, 3, 4, 1), values.permute(2, 0, 3, 1, 4)
