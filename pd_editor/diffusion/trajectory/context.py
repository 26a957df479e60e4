"""What the second stage remembers of a scene while futures are denoised."""

from dataclasses import dataclass

from jaxtyping import Bool, Float, Int
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    """Keys and values of the N things that each of G agents sees, in H heads."""

    keys: Float[Tensor, "G H N D"]
    values: Float[Tensor, "G H N D"]
    exists: Bool[Tensor, "G 1 1 N"]


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockMemory:
    """What one block of the network sees of the scene."""

    pieces: Memory
    candidates: Memory
    edge: Float[Tensor, "G K F"]
    """Of each neighbour: its place, its kind and so on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryContext:
    """G agents, those of all scenes in a row; K neighbours, the first being oneself."""

    agent: Float[Tensor, "G E"]
    blocks: tuple[BlockMemory, ...]
    neighbor: Int[Tensor, "G K"]
    """Rows of the neighbours."""
    has_neighbor: Bool[Tensor, "G 1 1 K"]
    neighbor_pose: Float[Tensor, "G K 4"]
    way_matrix: Float[Tensor, "10 W"]
    """With the offset, makes way points of latents."""
    way_offset: Float[Tensor, "G W"]
