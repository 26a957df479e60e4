"""The trajectory network's encoded scene and noise levels, for all denoising steps."""

from dataclasses import dataclass
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from pd_editor.diffusion.trajectory.block import BlockContext, Masks
from pd_editor.diffusion.trajectory.features import Neighbors
from pd_editor.diffusion.trajectory.interaction_features import InteractionGeometry


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryContext:
    """All that does not depend on noisy trajectories, of B scenes of A agents."""

    agent: Float[Tensor, "B A E"]
    blocks: tuple[BlockContext, ...]
    masks: Masks
    neighbors: Neighbors
    interactions: InteractionGeometry | None
    """None for a network without interaction features."""


class EncodedLevel(NamedTuple):
    """All that depends on noise levels only; of agents, or of all of them alike."""

    hidden: Float[Tensor, "*b NE"]
    """Added in the first layer and before each block."""
    alpha: Float[Tensor, "*b 1"]
    noisy_share: Float[Tensor, "*b 1"]
    """Of the noisy latents in the predicted clean ones."""
    output_share: Float[Tensor, "*b 1"]
    """Of the network's output in them."""

    def at(self, index: int) -> "EncodedLevel":
        """One of several levels along the first axis."""
        return EncodedLevel(*(one[index] for one in self))
