"""The second stage's network: from noisy futures of all agents to clean ones.

Each agent attends to the lane pieces around it, to its Frenet candidates and to its
neighbours (heterogeneous message passing, Path Diffuser section III-E). All places are
relative, so results do not change when a scene is turned or moved. What does not
depend on the noisy futures is computed once per scene. Neighbours are also seen where
they are believed to be going, which is looked at anew in every block.
"""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.diffusion.agent_block import AgentBlock
from pd_editor.diffusion.memory_encoder import MemoryEncoder
from pd_editor.diffusion.noise_schedule import NoiseSchedule, Prediction, ScheduleKind
from pd_editor.diffusion.relative_pose import (
    NUM_POSE_FEATURES,
    gathered,
    pose_features,
    relative_pose,
)
from pd_editor.diffusion.scene_tensors import SceneTensors
from pd_editor.diffusion.trajectory_basis import TrajectoryBasis
from pd_editor.diffusion.trajectory_context import (
    BlockMemory,
    TrajectoryContext,
)
from pd_editor.diffusion.way_points import WayPoints
from pd_editor.windows.packed_scene import LATENT_SIZE
from pd_editor.windows.scene_features import (
    AGENT_KINDS,
    NUM_FUTURE_STEPS,
    NUM_PIECE_KINDS,
    PIECE_SHAPE,
)

STANDING_MPS: Final = 0.3

_NUM_LEVEL_FEATURES: Final = 7
_NUM_AGENT_FEATURES: Final = 6 + len(AGENT_KINDS)


@dataclass(frozen=True, kw_only=True)
class TrajectoryConfig:
    """What decides the shapes of the weights, and what they mean."""

    width: int = 128
    num_heads: int = 4
    num_blocks: int = 3
    edge_width: int = 64
    """Width in which a neighbour's place and way are looked at."""
    sees_way_points: bool = True
    """Whether neighbours are seen where they are believed to be going."""
    schedule: ScheduleKind = "cosine"
    prediction: Prediction = "velocity"


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
        self.agent_in = nn.Linear(_NUM_AGENT_FEATURES, width)
        self.noisy_in = nn.Linear(LATENT_SIZE + _NUM_LEVEL_FEATURES, width)
        self.token = nn.Linear(width, width)
        self.level_bias = nn.Linear(_NUM_LEVEL_FEATURES, blocks * width)
        piece_size = NUM_POSE_FEATURES + len(PIECE_SHAPE) + NUM_PIECE_KINDS
        self.piece_memory = MemoryEncoder(piece_size, width, blocks, config.num_heads)
        self.candidate_memory = MemoryEncoder(
            LATENT_SIZE, width, blocks, config.num_heads
        )
        edge_size = NUM_POSE_FEATURES + 1 + 2 * _NUM_AGENT_FEATURES
        self.edge_in = nn.Linear(edge_size, blocks * config.edge_width)
        self.blocks = nn.ModuleList(
            AgentBlock(width, config.num_heads, config.edge_width)
            for _ in range(blocks)
        )

    def context(self, scene: SceneTensors) -> TrajectoryContext:
        """All that does not depend on the noisy futures."""
        scenes, agents = scene.has_agent.shape
        features = _agent_features(scene)
        sees = (scene.near_pieces >= 0) & gathered(scene.has_piece, scene.near_pieces)
        pieces = self.piece_memory(_pieces(scene), sees)
        candidates = self.candidate_memory(scene.candidates, scene.has_candidate)
        own = torch.arange(agents, device=features.device).expand(scenes, agents)
        near = torch.cat([own[..., None], scene.near_agents], dim=-1)
        meets = (near >= 0) & gathered(scene.has_agent, near)
        meets[:, :, 0] = True
        pose = relative_pose(
            gathered(scene.agent_pose, near), scene.agent_pose[:, :, None]
        )
        theirs = gathered(features, near)
        is_self = torch.zeros_like(theirs[..., :1])
        is_self[:, :, 0] = 1
        mine = features[:, :, None].expand_as(theirs)
        edge = self.edge_in(
            torch.cat([pose_features(pose), is_self, theirs, mine], dim=-1)
        )
        edges = edge.flatten(0, 1).chunk(self.config.num_blocks, dim=-1)
        offset = agents * torch.arange(scenes, device=features.device)
        way_matrix, way_offset = self.way_points.line(scene.agent_speed.flatten())
        return TrajectoryContext(
            agent=self.agent_in(features).flatten(0, 1),
            blocks=tuple(
                BlockMemory(pieces=one, candidates=two, edge=three)
                for one, two, three in zip(pieces, candidates, edges, strict=True)
            ),
            neighbor=(near.clamp_min(0) + offset[:, None, None]).flatten(0, 1),
            has_neighbor=meets.flatten(0, 1)[:, None, None],
            neighbor_pose=pose.flatten(0, 1),
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


def _pieces(scene: SceneTensors) -> Float[Tensor, "B A M E"]:
    kind = nn.functional.one_hot(scene.piece_kind, NUM_PIECE_KINDS)
    shape = torch.cat([scene.piece_shape, kind.to(scene.piece_shape)], dim=-1)
    pose = relative_pose(
        gathered(scene.piece_pose, scene.near_pieces), scene.agent_pose[:, :, None]
    )
    near = gathered(shape, scene.near_pieces)
    return torch.cat([pose_features(pose), near], dim=-1)


def _agent_features(scene: SceneTensors) -> Float[Tensor, "B A F"]:
    speed = scene.agent_speed
    numbers = torch.stack(
        [
            speed / 10,
            torch.tanh(speed),
            (speed < STANDING_MPS).to(speed),
            scene.agent_size[..., 0] / 5,
            scene.agent_size[..., 1] / 2,
            scene.has_candidate.any(-1).to(speed),
        ],
        dim=-1,
    )
    kind = nn.functional.one_hot(scene.agent_kind, len(AGENT_KINDS)).to(speed)
    return torch.cat([numbers, kind], dim=-1)


def level_features(
    level: Float[Tensor, "*shape 1"],
    alpha: Float[Tensor, "*shape 1"],
    sigma: Float[Tensor, "*shape 1"],
) -> Float[Tensor, "*shape 7"]:
    """A noise level in numbers of about one."""
    return torch.cat(
        [
            level,
            alpha,
            sigma,
            torch.tanh(10 * level),
            torch.sin(torch.pi * 2 * level),
            torch.cos(torch.pi * 4 * level),
            (level == 0).to(level),
        ],
        dim=-1,
    )
