"""Keys and values of what agents see, for all blocks of a network at once."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.diffusion.trajectory.context import Memory


class MemoryEncoder(nn.Module):
    """Encodes N things around each agent once per scene."""

    def __init__(self, size: int, width: int, num_blocks: int, num_heads: int) -> None:
        super().__init__()
        self.shape = (num_blocks, 2, num_heads, -1)
        self.things = nn.Sequential(
            nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()
        )
        self.nothing = nn.Parameter(torch.zeros(width))
        self.keys_values = nn.Linear(width, num_blocks * 2 * width)

    def forward(
        self, things: Float[Tensor, "B A N F"], exists: Bool[Tensor, "B A N"]
    ) -> list[Memory]:
        """What each block sees, with a first entry for nothing."""
        hidden = self.things(things.flatten(0, 1))
        nothing = self.nothing.to(hidden).expand(len(hidden), 1, -1)
        encoded = self.keys_values(torch.cat([nothing, hidden], dim=1))
        mask = nn.functional.pad(exists, (1, 0), value=True).flatten(0, 1)
        # One copy brings the heads in front of the things, for all blocks at once.
        table = encoded.unflatten(-1, self.shape).permute(2, 3, 0, 4, 1, 5).contiguous()
        return [
            Memory(keys=keys, values=values, exists=mask[:, None, None])
            for keys, values in table
        ]
