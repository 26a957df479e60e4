"""Encoded scene and noise levels of the trajectory network, for all denoising steps."""

from dataclasses import dataclass
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from pd_editor.generation.trajectory.network.block import BlockContext, Masks
from pd_editor.generation.trajectory.network.features import Neighbors
from pd_editor.generation.trajectory.network.interaction_features import (
    InteractionGeometry,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryContext:
    """Values that do not depend on noisy trajectories, for B scenes of A agents."""

    agent: Float[Tensor, "B A E"]
    blocks: tuple[BlockContext, ...]
    masks: Masks
    neighbors: Neighbors
    interactions: InteractionGeometry | None
    """Geometry of interaction features; None for a network without them."""


class EncodedTrajectoryLevel(NamedTuple):
    """Values that depend on noise levels only, per agent or for all agents."""

    hidden: Float[Tensor, "*b NE"]
    """Terms of the first layer and of the input of each block."""
    alpha: Float[Tensor, "*b 1"]
    noisy_share: Float[Tensor, "*b 1"]
    """Factor of the noisy latents in the predicted clean ones."""
    output_share: Float[Tensor, "*b 1"]
    """Factor of the network's output in the predicted clean latents."""

    def at(self, index: int) -> "EncodedTrajectoryLevel":
        """Select one of several levels along the first axis."""
        return EncodedTrajectoryLevel(*(one[index] for one in self))
