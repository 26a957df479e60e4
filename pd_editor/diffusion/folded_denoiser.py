"""The second stage's network made ready for drawing: the same in fewer operations.

At a few agents it is the number of operations that takes the time. Everything that
depends on the scene or on the noise levels is computed before the first step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import linear, pad

from pd_editor.diffusion.agent_block import AgentBlock
from pd_editor.diffusion.folded_block import FoldedBlock, FoldedMemory, Surroundings
from pd_editor.diffusion.trajectory_context import BlockMemory, TrajectoryContext
from pd_editor.diffusion.trajectory_denoiser import TrajectoryDenoiser, level_features
from pd_editor.diffusion.way_points import NEAR_M

_LEAST_SQUARE: Final = 1e-6
_FAST_WIDTH: Final = 16
"""At multiples of it a softmax over few numbers is several times as fast."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Levels:
    """What depends on the noise level only, for L levels; the last one is 0."""

    first: Float[Tensor, "L E"]
    """Share of the first layer."""
    biases: Float[Tensor, "L N E"]
    """Of each block."""
    noisy_share: Float[Tensor, "L 1"]
    """Of the noisy latents in what is taken for clean."""
    output_share: Float[Tensor, "L 1"]
    """Of the network's output in it."""
    alpha: Float[Tensor, "L 1"]


class FoldedDenoiser:
    """Weights of a denoiser, put together so that a step is few operations."""

    def __init__(self, model: TrajectoryDenoiser) -> None:
        """Weights are copied: the model may be trained on."""
        self.model = model
        with torch.no_grad():
            self.blocks = [
                FoldedBlock(block)
                for block in model.blocks
                if isinstance(block, AgentBlock)
            ]

    def drawing(
        self,
        context: TrajectoryContext,
        is_given: Bool[Tensor, "B A"],
        levels: Sequence[float],
        num_samples: int,
    ) -> "FutureDrawing":
        """Make ready to denoise samples of some scenes at some noise levels."""
        return FutureDrawing(self, context, is_given, levels, num_samples)

    def levels(self, levels: Sequence[float]) -> _Levels:
        """What the network makes of noise levels."""
        model, schedule = self.model, self.model.schedule
        like = model.noisy_in.weight
        level = torch.tensor([*levels, 0.0], dtype=like.dtype, device=like.device)
        level = level[:, None]
        alpha, sigma = schedule.alpha(level), schedule.sigma(level)
        features = level_features(level, alpha, sigma)
        size = features.shape[-1]
        zero, one = torch.zeros_like(level), torch.ones_like(level)
        is_noisy = level > 0
        return _Levels(
            first=linear(features, like[:, -size:], model.noisy_in.bias),
            biases=model.level_bias(features).unflatten(-1, (len(self.blocks), -1)),
            # What counts as clean is linear in both.
            noisy_share=torch.where(is_noisy, schedule.clean_of(zero, one, level), 1.0),
            output_share=torch.where(
                is_noisy, schedule.clean_of(one, zero, level), 0.0
            ),
            alpha=alpha,
        )


class FutureDrawing:
    """Denoises S samples of B scenes, at levels that are known beforehand."""

    def __init__(
        self,
        network: FoldedDenoiser,
        context: TrajectoryContext,
        is_given: Bool[Tensor, "B A"],
        levels: Sequence[float],
        num_samples: int,
    ) -> None:
        """Given agents are at level 0: they come out as they go in."""
        self._network, self._shape = network, is_given.shape
        self._levels = network.levels(levels)
        self._given = is_given[..., None] if bool(is_given.any()) else None
        self._agent = context.agent.unflatten(0, is_given.shape)
        self._around = _surroundings(context, is_given.shape, num_samples)
        self._memories = [_folded_memory(block) for block in context.blocks]
        self._ways = (
            _WayLines(context) if network.model.config.sees_way_points else None
        )

    def denoise(
        self, noisy: Float[Tensor, "S B A 10"], index: int
    ) -> Float[Tensor, "S B A 10"]:
        """Clean latents of noisy ones at one of the levels."""
        model, levels = self._network.model, self._levels
        first = linear(noisy, model.noisy_in.weight[:, : noisy.shape[-1]])
        first = first.add_(self._agent).add_(self._at(levels.first, index))
        hidden = model.token(first.relu_())
        kept = self._at(levels.noisy_share, index) * noisy
        output_share = self._at(levels.output_share, index)
        guess = self._at(levels.alpha, index) * noisy
        for number, block in enumerate(self._network.blocks):
            hidden = hidden + self._at(levels.biases[:, number], index)
            ways = None if self._ways is None else self._ways.features(guess)
            found, output = block(
                hidden.flatten(0, 2), ways, self._memories[number], self._around
            )
            hidden = found.view(hidden.shape)
            guess = torch.addcmul(kept, output_share, output.view(noisy.shape))
        return guess

    def _at(self, table: Float[Tensor, "L F"], index: int) -> Float[Tensor, "*a F"]:
        """The row of a level; of level 0 for agents that are given."""
        row = table[index]
        return row if self._given is None else torch.where(self._given, table[-1], row)


class _WayLines:
    """Way points of all neighbours against one's own, as in ``WayPoints``."""

    def __init__(self, context: TrajectoryContext) -> None:
        matrix, offset = context.way_matrix, context.way_offset
        half = matrix.shape[1] // 2
        # With a quarter turn beside it, a turn is two products.
        self._matrix = torch.cat([matrix, -matrix[:, half:], matrix[:, :half]], dim=1)
        self._offset = torch.cat([offset, -offset[:, half:], offset[:, :half]], dim=1)
        self._half = half
        self._neighbor = context.neighbor.flatten()
        x, y, cos, sin = context.neighbor_pose.flatten(0, 1)[..., None].unbind(-2)
        self._cos, self._sin = cos.contiguous(), sin.contiguous()
        self._place = torch.cat([x.expand(-1, half), y.expand(-1, half)], dim=1)

    def features(self, guess: Float[Tensor, "S B A 10"]) -> Float[Tensor, "N 24"]:
        """Directions and closeness; closeness per metre."""
        points = (guess.flatten(1, 2) @ self._matrix).add_(self._offset)
        own = points[..., : 2 * self._half]
        num_agents = own.shape[1]
        theirs = points.index_select(1, self._neighbor)
        along, across = theirs.chunk(2, dim=-1)
        gap = torch.addcmul(self._place, self._cos, along)
        gap = gap.addcmul_(self._sin, across)
        gap = gap.unflatten(1, (num_agents, -1)).sub_(own[:, :, None]).flatten(1, 2)
        square = gap.square()
        near = square[..., : self._half] + square[..., self._half :]
        near = near.add_(_LEAST_SQUARE).sqrt_().add_(NEAR_M).reciprocal_()
        ahead, beside = gap.chunk(2, dim=-1)
        return torch.cat([ahead * near, beside * near, near], dim=-1).flatten(0, 1)


def _surroundings(
    context: TrajectoryContext, shape: torch.Size, num_samples: int
) -> Surroundings:
    scenes, agents = shape
    heads = context.blocks[0].pieces.keys.shape[1]
    number = max(_num_things(context.blocks[0]))
    memories = (context.blocks[0].pieces, context.blocks[0].candidates)
    exists = torch.cat(
        [
            pad(one.exists, (0, number - one.exists.shape[-1])).expand(
                -1, heads, -1, -1
            )
            for one in memories
        ],
        dim=1,
    )
    offset = agents * torch.arange(scenes, device=exists.device)
    neighbor = context.neighbor.unflatten(0, shape) - offset[:, None, None]
    meets = context.has_neighbor.view(scenes, 1, agents, -1)
    num_neighbors = neighbor.shape[-1]
    fill = (0, -num_neighbors % _FAST_WIDTH)
    neighbor = pad(neighbor, fill)[:, None].expand(-1, heads, -1, -1)
    dtype = context.agent.dtype
    return Surroundings(
        hidden_things=_hidden(exists, dtype),
        num_neighbors=num_neighbors,
        neighbor=neighbor.repeat(num_samples, 1, 1, 1),
        hidden_neighbors=_hidden(pad(meets, fill), dtype).repeat(num_samples, 1, 1, 1),
    )


def _folded_memory(block: BlockMemory) -> FoldedMemory:
    number = max(_num_things(block))
    keys, values = (
        torch.cat(
            [pad(one, (0, 0, 0, number - one.shape[-2])) for one in both], dim=1
        ).to(block.edge.dtype)
        for both in (
            (block.pieces.keys, block.candidates.keys),
            (block.pieces.values, block.candidates.values),
        )
    )
    return FoldedMemory(
        keys=keys.mT.contiguous(), values=values, edge=block.edge.flatten(0, 1)
    )


def _num_things(block: BlockMemory) -> tuple[int, int]:
    return block.pieces.keys.shape[-2], block.candidates.keys.shape[-2]


def _hidden(
    exists: Bool[Tensor, "*shape"], dtype: torch.dtype
) -> Float[Tensor, "*shape"]:
    """Minus infinity where there is nothing."""
    table = torch.zeros(exists.shape, dtype=dtype, device=exists.device)
    return table.masked_fill_(~exists, -torch.inf)
