"""A pose proposed by each map token near an agent, and the weights of the proposals."""

from typing import Final

from jaxtyping import Complex, Float
from torch import Tensor, nn

from pd_editor.diffusion.core.attention import Mask
from pd_editor.diffusion.initial_state.features import as_complex

_NUM_PARTS: Final = 4
"""Offset and direction, both as vectors in the token's frame."""


class LaneAnchoredHead(nn.Module):
    """Each near map token proposes a pose in its own frame; the agent weighs them.

    How far a car is from the middle of its lane, and that it points along it, is simple
    in the frame of that lane only; means over attention blur it.
    """

    def __init__(self, width: int, num_features: int) -> None:
        super().__init__()
        self.from_relation = nn.Linear(num_features, width, bias=False)
        self.propose = nn.Linear(width, 1 + _NUM_PARTS)

    def forward(
        self,
        agent: Float[Tensor, "B S A D"],
        relations: Float[Tensor, "B S A M F"],
        tokens: Float[Tensor, "B S A M D"],
        axis: Complex[Tensor, "B S A M"],
        mask: Mask,
    ) -> Complex[Tensor, "B S A 2"]:
        """Offset and direction in the frame of the scene; 0 where no token is near.

        Args:
            agent: what the network has made of each agent.
            relations: of the agent to each token.
            tokens: what the head knows of each token besides.
            axis: directions of the tokens in the frame of the scene.
            mask: of shape [B S A 1 M].
        """
        hidden = self.from_relation(relations).add_(tokens)
        hidden = hidden.add_(agent[..., None, :]).relu_()
        logits, poses = self.propose(hidden).float().split([1, _NUM_PARTS], dim=-1)
        weights = mask.weights(logits.mT).squeeze(-2)
        proposals = as_complex(poses.unflatten(-1, (2, 2)))
        return ((weights * axis)[..., None] * proposals).sum(dim=-2)
