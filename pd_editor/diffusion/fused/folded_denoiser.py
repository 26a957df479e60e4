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

from pd_editor.diffusion.fused.folded_block import (
    BlockSurroundings,
    FoldedBlock,
    Surroundings,
)
from pd_editor.diffusion.fused.folded_memory import (
    FoldedMemory,
    Things,
    ThingsSeen,
    minus_infinity_unless,
)
from pd_editor.diffusion.fused.way_lines import WayLines
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.trajectory.block import AgentBlock
from pd_editor.diffusion.trajectory.denoiser import TrajectoryDenoiser
from pd_editor.diffusion.trajectory.features import (
    Neighbors,
    agent_features,
    level_features,
    piece_features,
    seen_pieces,
)

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
        """Fold again after training: some weights are copied, some are the model's."""
        self.model = model
        self.num_heads = model.config.num_heads
        with torch.no_grad():
            self._memory = FoldedMemory(model.piece_memory, model.candidate_memory)
            self.blocks = [
                FoldedBlock(block)
                for block in model.blocks
                if isinstance(block, AgentBlock)
            ]

    def context(self, scene: SceneTensors) -> "FoldedContext":
        """All that does not depend on the noisy futures."""
        model = self.model
        features, neighbors = agent_features(scene), Neighbors.of(scene)
        edges = model.edge_in(neighbors.edge_features(features))
        pieces = Things(
            facts=piece_features(scene).flatten(0, 1),
            exists=seen_pieces(scene).flatten(0, 1),
        )
        candidates = Things(
            facts=scene.candidates.flatten(0, 1),
            exists=scene.has_candidate.flatten(0, 1),
        )
        lines = None
        if model.config.sees_way_points:
            speed = scene.agent_speed.flatten()
            lines = WayLines(*model.way_points.line(speed), neighbors)
        return FoldedContext(
            agent=model.agent_in(features),
            things=self._memory.seen(pieces, candidates),
            edges=edges.flatten(0, 2).chunk(len(self.blocks), dim=-1),
            neighbors=neighbors,
            lines=lines,
        )

    def drawing(
        self,
        context: "FoldedContext",
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


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldedContext:
    """What the network needs of B scenes of A agents at each step."""

    agent: Float[Tensor, "B A E"]
    things: ThingsSeen
    edges: Sequence[Float[Tensor, "N F"]]
    """Of each block: the neighbours of all agents in a row."""
    neighbors: Neighbors
    lines: WayLines | None

    def surroundings(self, num_samples: int, num_heads: int) -> Surroundings:
        """What the blocks see of samples of the scenes."""
        row, exists = self.neighbors.row, self.neighbors.exists
        fill = (0, -row.shape[-1] % _FAST_WIDTH)
        hidden = minus_infinity_unless(pad(exists, fill), self.agent)
        return Surroundings(
            hidden_things=self.things.hidden,
            num_neighbors=row.shape[-1],
            neighbor=pad(row, fill)[:, None].repeat(num_samples, num_heads, 1, 1),
            hidden_neighbors=hidden[:, None].repeat(num_samples, 1, 1, 1),
        )


class FutureDrawing:
    """Denoises S samples of B scenes, at levels that are known beforehand."""

    def __init__(
        self,
        network: FoldedDenoiser,
        context: FoldedContext,
        is_given: Bool[Tensor, "B A"],
        levels: Sequence[float],
        num_samples: int,
    ) -> None:
        """Given agents are at level 0: they come out as they go in."""
        self._network, self._context = network, context
        self._levels = network.levels(levels)
        self._given = is_given[..., None] if bool(is_given.any()) else None
        self._around = context.surroundings(num_samples, network.num_heads)
        things = context.things
        self._seen = [
            BlockSurroundings(keys=keys, values=values, edge=edge)
            for keys, values, edge in zip(
                things.keys, things.values, context.edges, strict=True
            )
        ]

    def denoise(
        self, noisy: Float[Tensor, "S B A 10"], index: int
    ) -> Float[Tensor, "S B A 10"]:
        """Clean latents of noisy ones at one of the levels."""
        model, levels = self._network.model, self._levels
        lines = self._context.lines
        first = linear(noisy, model.noisy_in.weight[:, : noisy.shape[-1]])
        first = first.add_(self._context.agent).add_(self._at(levels.first, index))
        hidden = model.token(first.relu_())
        kept = self._at(levels.noisy_share, index) * noisy
        output_share = self._at(levels.output_share, index)
        guess = self._at(levels.alpha, index) * noisy
        for number, block in enumerate(self._network.blocks):
            hidden = hidden + self._at(levels.biases[:, number], index)
            ways = None if lines is None else lines.features(guess)
            found, output = block(
                hidden.flatten(0, 2), ways, self._seen[number], self._around
            )
            hidden = found.view(hidden.shape)
            guess = torch.addcmul(kept, output_share, output.view(noisy.shape))
        return guess

    def _at(self, table: Float[Tensor, "L F"], index: int) -> Float[Tensor, "*a F"]:
        """The row of a level; of level 0 for agents that are given."""
        row = table[index]
        return row if self._given is None else torch.where(self._given, table[-1], row)
