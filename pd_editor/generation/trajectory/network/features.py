"""Input features of the trajectory network: agents, map tokens and noise levels."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.generation.features.scene_features import (
    AGENT_KINDS,
    BOUNDARY_SHAPE,
    NUM_PIECE_KINDS,
    PIECE_SHAPE,
)
from pd_editor.generation.inputs.relative_pose import (
    NUM_POSE_FEATURES,
    gathered,
    pose_features,
    relative_pose,
)
from pd_editor.generation.inputs.scene_batch import SceneTensors
from pd_editor.scene.thresholds import STANDING_MPS

NUM_LEVEL_FEATURES: Final = 7
NUM_AGENT_FEATURES: Final = 6 + len(AGENT_KINDS)
NUM_PIECE_FEATURES: Final = NUM_POSE_FEATURES + len(PIECE_SHAPE) + NUM_PIECE_KINDS
NUM_BOUNDARY_FEATURES: Final = NUM_POSE_FEATURES + len(BOUNDARY_SHAPE)
NUM_EDGE_FEATURES: Final = NUM_POSE_FEATURES + 1 + 2 * NUM_AGENT_FEATURES


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbors:
    """The K neighbours of each agent in its scene, the first being itself."""

    row: Int[Tensor, "B A K"]
    """Row of each neighbour; arbitrary where there is none."""
    exists: Bool[Tensor, "B A K"]
    pose: Float[Tensor, "B A K 4"]
    """Poses of neighbours in the agent's frame."""

    @classmethod
    def of(cls, scene: SceneTensors, num_near: int) -> "Neighbors":
        """The agent itself and the ``num_near`` nearest others."""
        scenes, agents = scene.has_agent.shape
        own = torch.arange(agents, device=scene.has_agent.device)
        own = own.expand(scenes, agents)[..., None]
        near = torch.cat([own, scene.near_agents[..., :num_near]], dim=-1)
        exists = (near >= 0) & gathered(scene.has_agent, near)
        exists[:, :, 0] = True
        pose = relative_pose(
            gathered(scene.agent_pose, near), scene.agent_pose[:, :, None]
        )
        return cls(row=near.clamp_min(0), exists=exists, pose=pose)

    def row_of_all(self) -> Int[Tensor, "B A K"]:
        """Row of each neighbour among the agents of all scenes."""
        scenes, agents = self.row.shape[:2]
        first = agents * torch.arange(scenes, device=self.row.device)
        return self.row + first[:, None, None]

    def edge_features(self, agents: Float[Tensor, "B A F"]) -> Float[Tensor, "B A K E"]:
        """Pose and features of each neighbour, and features of the agent itself."""
        theirs = gathered(agents, self.row)
        is_self = torch.zeros_like(theirs[..., :1])
        is_self[:, :, 0] = 1
        mine = agents[:, :, None].expand_as(theirs)
        return torch.cat([pose_features(self.pose), is_self, theirs, mine], dim=-1)


def seen_pieces(scene: SceneTensors) -> Bool[Tensor, "B A M"]:
    """Mask of the nearest lane pieces."""
    return (scene.near_pieces >= 0) & gathered(scene.has_piece, scene.near_pieces)


def seen_boundary(scene: SceneTensors) -> Bool[Tensor, "B A N"]:
    """Mask of the nearest boundary pieces."""
    near = scene.near_boundary
    return (near >= 0) & gathered(scene.has_boundary, near)


def piece_features(
    scene: SceneTensors, *, sees_signals: bool = False
) -> Float[Tensor, "B A M E"]:
    """Features of the lane pieces near each agent, in its frame."""
    kind = nn.functional.one_hot(scene.piece_kind, NUM_PIECE_KINDS)
    shape = torch.cat([scene.piece_shape, kind.to(scene.piece_shape)], dim=-1)
    if sees_signals:
        shape = torch.cat([shape, scene.piece_signal], dim=-1)
    return _as_seen(scene, scene.piece_pose, shape, scene.near_pieces)


def boundary_features(scene: SceneTensors) -> Float[Tensor, "B A N E"]:
    """Features of the boundary pieces near each agent, in its frame."""
    return _as_seen(
        scene, scene.boundary_pose, scene.boundary_shape, scene.near_boundary
    )


def _as_seen(
    scene: SceneTensors,
    pose: Float[Tensor, "B P 3"],
    shape: Float[Tensor, "B P F"],
    near: Int[Tensor, "B A M"],
) -> Float[Tensor, "B A M E"]:
    relative = relative_pose(gathered(pose, near), scene.agent_pose[:, :, None])
    return torch.cat([pose_features(relative), gathered(shape, near)], dim=-1)


def agent_features(scene: SceneTensors) -> Float[Tensor, "B A F"]:
    """Features of an agent, apart from its pose."""
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
    """Features of a noise level, of about unit scale."""
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
