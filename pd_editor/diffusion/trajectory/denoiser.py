"""The second stage's network: from noisy futures of all agents to clean ones.

Each agent attends to the lane pieces around it, to its Frenet candidates and to its
neighbours (heterogeneous message passing, Path Diffuser section III-E). All places are
relative, so results do not change when a scene is turned or moved. What does not
depend on the noisy futures is computed once per scene. Neighbours are also seen where
they are believed to be going, which is looked at anew in every block.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.diffusion.core.config_limits import check_sizes
from pd_editor.diffusion.core.noise_schedule import (
    NoiseSchedule,
    Prediction,
    ScheduleKind,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.diffusion.trajectory.block import AgentBlock
from pd_editor.diffusion.trajectory.context import (
    BlockMemory,
    TrajectoryContext,
)
from pd_editor.diffusion.trajectory.features import (
    NUM_AGENT_FEATURES,
    NUM_EDGE_FEATURES,
    NUM_LEVEL_FEATURES,
    NUM_PIECE_FEATURES,
    Neighbors,
    agent_features,
    level_features,
    piece_features,
    seen_pieces,
)
from pd_editor.diffusion.trajectory.interaction_features import WayPoints
from pd_editor.diffusion.trajectory.memory_encoder import MemoryEncoder
from pd_editor.windows.packed_scene import LATENT_SIZE
from pd_editor.windows.scene_features import NUM_FUTURE_STEPS


@dataclass(frozen=True, kw_only=True)
class TrajectoryConfig:
    """What decides the shapes of the weights, and what they mean."""

    width: int = 128
    num_heads: int = 4
    num_blocks: int = 2
    edge_width: int = 64
    """Width in which a neighbour's place and way are looked at."""
    sees_way_points: bool = True
    """Whether neighbours are seen where they are believed to be going."""
    schedule: ScheduleKind = "cosine"
    prediction: Prediction = "velocity"

    def __post_init__(self) -> None:
        check_sizes(self)


class TrajectoryDenoiser(nn.Module):
    """Predicts clean futures, as latents of its trajectory basis."""

    def __init__(
        self, config: TrajectoryConfig, basis: TrajectoryBasis | None = None
    ) -> None:
        """Without a basis, one is expected to be loaded with the weights."""
        super().__init__()
        self.config = config
        self.schedule = NoiseSchedule(
            kind=config.schedule, prediction=config.prediction
        )
        self.way_points = WayPoints(basis, NUM_FUTURE_STEPS)
        width, blocks = config.width, config.num_blocks
        self.agent_in = nn.Linear(NUM_AGENT_FEATURES, width)
        self.noisy_in = nn.Linear(LATENT_SIZE + NUM_LEVEL_FEATURES, width)
        self.token = nn.Linear(width, width)
        self.level_bias = nn.Linear(NUM_LEVEL_FEATURES, blocks * width)
        self.piece_memory = MemoryEncoder(
            NUM_PIECE_FEATURES, width, blocks, config.num_heads
        )
        self.candidate_memory = MemoryEncoder(
            LATENT_SIZE, width, blocks, config.num_heads
        )
        self.edge_in = nn.Linear(NUM_EDGE_FEATURES, blocks * config.edge_width)
        self.blocks = nn.ModuleList(
            AgentBlock(width, config.num_heads, config.edge_width)
            for _ in range(blocks)
        )

    def context(self, scene: SceneTensors) -> TrajectoryContext:
        """All that does not depend on the noisy futures."""
        scenes, agents = scene.has_agent.shape
        features = agent_features(scene)
        pieces = self.piece_memory(piece_features(scene), seen_pieces(scene))
        candidates = self.candidate_memory(scene.candidates, scene.has_candidate)
        neighbors = Neighbors.of(scene)
        edge = self.edge_in(neighbors.edge_features(features))
        edges = edge.flatten(0, 1).chunk(self.config.num_blocks, dim=-1)
        offset = agents * torch.arange(scenes, device=features.device)
        way_matrix, way_offset = self.way_points.line(scene.agent_speed.flatten())
        return TrajectoryContext(
            agent=self.agent_in(features).flatten(0, 1),
            blocks=tuple(
                BlockMemory(pieces=one, candidates=two, edge=three)
                for one, two, three in zip(pieces, candidates, edges, strict=True)
            ),
            neighbor=(neighbors.row + offset[:, None, None]).flatten(0, 1),
            has_neighbor=neighbors.exists.flatten(0, 1)[:, None, None],
            neighbor_pose=neighbors.pose.flatten(0, 1),
            way_matrix=way_matrix,
            way_offset=way_offset,
        )

    def denoise(
        self,
        context: TrajectoryContext,
        noisy: Float[Tensor, "S B A 10"],
        level: Float[Tensor, "S B A"],
    ) -> Float[Tensor, "S B A 10"]:
        """Clean latents; agents at level 0 are taken as given and come out as is."""
        return self.guesses(context, noisy, level)[-1]

    def guesses(
        self,
        context: TrajectoryContext,
        noisy: Float[Tensor, "S B A 10"],
        level: Float[Tensor, "S B A"],
    ) -> list[Float[Tensor, "S B A 10"]]:
        """What each block takes for clean; the last one is the result."""
        flat, flat_level = noisy.flatten(1, 2), level.flatten(1, 2)[..., None]
        alpha, sigma = self.schedule.alpha(flat_level), self.schedule.sigma(flat_level)
        levels = level_features(flat_level, alpha, sigma)
        hidden = self.noisy_in(torch.cat([flat, levels], dim=-1)) + context.agent
        hidden = self.token(nn.functional.relu(hidden))
        biases = self.level_bias(levels).chunk(self.config.num_blocks, dim=-1)
        # The best linear guess at a latent of unit variance.
        guess = alpha * flat
        guesses: list[Tensor] = []
        for block, memory, bias in zip(
            self.blocks, context.blocks, biases, strict=True
        ):
            ways = (
                self.way_points(guess.detach(), context)
                if self.config.sees_way_points
                else None
            )
            hidden, output = block(hidden + bias, ways, memory, context)
            clean = self.schedule.clean_of(output.to(flat), flat, flat_level)
            guess = torch.where(flat_level > 0, clean, flat)
            guesses.append(guess.unflatten(1, noisy.shape[1:3]))
        return guesses
