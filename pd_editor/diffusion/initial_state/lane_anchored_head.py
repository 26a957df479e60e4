"""Where each agent would be by each piece of road near it, and whom to believe."""

from typing import Final, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.diffusion.core.attention import Mask, attention_weights
from pd_editor.diffusion.initial_state.features import turned

_NUM_PARTS: Final = 4
"""Shift and turn, both as vectors in the piece's frame."""


class NearPieces(NamedTuple):
    """The M pieces of road near each of Q agents, as the agent lies to them."""

    axis: Float[Tensor, "B Q M 2"]
    """Direction of each piece, in the frame of the scene."""
    facts: Float[Tensor, "B Q M F"]
    relations: Float[Tensor, "B Q M R"]
    """Embedded facts."""
    mask: Mask
    """Of shape [B Q 1 M]."""


class LaneVotes(nn.Module):
    """Each near piece votes for a pose in its own frame; the agent weighs the votes.

    How far a car is from the middle of its lane, and that it points along it, is simple
    in the frame of that lane only; means over attention blur it.
    """

    def __init__(self, width: int, num_facts: int, relation_width: int) -> None:
        super().__init__()
        self.from_token = nn.Linear(width, width)
        self.from_piece = nn.Linear(num_facts + relation_width, width, bias=False)
        self.vote = nn.Linear(width, 1 + _NUM_PARTS)

    def forward(
        self, token: Float[Tensor, "B Q D"], near: NearPieces
    ) -> Float[Tensor, "B Q 4"]:
        """Shift and turn in the frame of the scene; 0 where no piece is near."""
        pieces = self.from_piece(torch.cat([near.facts, near.relations], dim=-1))
        hidden = nn.functional.relu(pieces + self.from_token(token)[:, :, None])
        logits, pose = self.vote(hidden).float().split([1, _NUM_PARTS], dim=-1)
        weights = attention_weights(logits.transpose(-1, -2), near.mask)
        votes = turned(pose.unflatten(-1, (2, 2)), near.axis[..., None, :])
        return (weights @ votes.flatten(-2)).squeeze(-2)
