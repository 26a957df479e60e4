"""Input features of the trajectory network: agents and pairs, map tokens, noise levels."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.generation.features.map_pieces import (
    BOUNDARY_SHAPE,
    NUM_PIECE_KINDS,
    PIECE_SHAPE,
)
from pd_editor.generation.features.scene_features import AGENT_KINDS
from pd_editor.generation.inputs import (
    NEAR_M,
    NUM_POSE_FEATURES,
    SceneTensors,
    gathered,
    pose_features,
    relative_pose,
)
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
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


NUM_WAYPOINTS: Final = 8
NUM_WAYPOINT_FEATURES: Final = 3 * NUM_WAYPOINTS
NUM_GAP_FEATURES: Final = 2 * NUM_WAYPOINTS

_LEAST_SQUARE: Final = 1e-6 / NEAR_M**2
_HELD: Final = 0.2 / NEAR_M
"""An agent that moves less between two waypoints keeps its heading."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InteractionGeometry:
    """Geometry of the waypoints of G agents and their K neighbours, without latents.

    Lengths are in units of 4 m. Rows of pairs come last, so that operations on the N
    waypoints of all pairs are on memory in a row.
    """

    matrix: Float[Tensor, "N4 10"]
    """Latents to x and y of the waypoints, and of the ways to each waypoint from the one
    before."""
    offset: Float[Tensor, "N4 1 G"]
    row: Int[Tensor, "R"]
    cos: Float[Tensor, "R"]
    sin: Float[Tensor, "R"]
    """Sine of the neighbour's heading in the agent's frame."""
    position: Float[Tensor, "2 1 1 G K"]
    """Position of the neighbour in the agent's frame."""
    half_size: Float[Tensor, "2 G 1"]
    """Half the length and half the width of each agent."""
    near_half_size: Float[Tensor, "2 G K"]
    """Of the neighbours."""

    @classmethod
    def of(
        cls,
        decoder: TrajectoryDecoder,
        speed_mps: Float[Tensor, "B A"],
        size_m: Float[Tensor, "B A 2"],
        neighbors: Neighbors,
    ) -> "InteractionGeometry":
        """Make the geometry; waypoints are evenly spaced up to the end."""
        ends = torch.linspace(
            0, decoder.num_steps, NUM_WAYPOINTS + 1, device=speed_mps.device
        )
        matrix, mean, times = decoder.matrix(ends[1:].long() - 1)
        offset = mean + speed_mps.flatten()[:, None] * times
        pose = neighbors.pose.flatten(0, 1).movedim(-1, 0)
        row = neighbors.row_of_all().flatten(0, 1)
        half_size = size_m.flatten(0, 1).T * (0.5 / NEAR_M)
        held = torch.zeros_like(offset[:1])
        held[:, :NUM_WAYPOINTS] = _HELD
        matrix, offset = matrix / NEAR_M, offset / NEAR_M
        return cls(
            matrix=torch.cat([matrix, _ways(matrix)], dim=-1).T.contiguous(),
            offset=torch.cat([offset, _ways(offset) + held], dim=-1).T[:, None],
            row=row.flatten(),
            cos=pose[2].flatten(),
            sin=pose[3].flatten(),
            position=pose[:2, None, None] / NEAR_M,
            half_size=half_size[..., None],
            near_half_size=half_size[:, row],
        )

    def features(
        self, latent: Float[Tensor, "S B A 10"], *, with_gaps: bool
    ) -> Float[Tensor, "S R F"]:
        """Offsets dampened with distance, and closeness, at each waypoint.

        With gaps, also the gap between the boxes, and the distance to the neighbour along
        the agent's own path.
        """
        samples, num_agents = latent.shape[0], self.half_size.shape[1]
        # Latents are transposed: rows of agents come last.
        found = self.matrix @ latent.flatten(0, -2).T
        found = found.view(-1, samples, num_agents) + self.offset
        own, ways = found.view(2, 2, NUM_WAYPOINTS, samples, num_agents).unbind()
        if not with_gaps:
            x, y = (self._seen(own) + self.position - own[..., None]).unbind()
            closeness = _closeness(x, y)
            parts = [x * closeness, y * closeness, closeness]
        else:
            direction = ways * _square_distance(*ways.unbind()).rsqrt_()
            seen = self._seen(torch.cat([own, direction], dim=1))
            theirs, their_direction = seen.chunk(2, dim=1)
            x, y = (theirs + self.position - own[..., None]).unbind()
            closeness = _closeness(x, y)
            gap, ahead = self._gaps(direction[..., None], their_direction, x, y)
            # Gaps are clamped to this: 2 m in units of 4 m scaled features.
            gap = gap.mul_(2.0).tanh_()
            parts = [x * closeness, y * closeness, closeness, gap, ahead * closeness]
        return torch.cat(parts).flatten(2).movedim(0, -1)

    def _gaps(
        self,
        direction: Float[Tensor, "2 N S G 1"],
        their_direction: Float[Tensor, "2 N S G K"],
        x: Float[Tensor, "N S G K"],
        y: Float[Tensor, "N S G K"],
    ) -> tuple[Float[Tensor, "N S G K"], Float[Tensor, "N S G K"]]:
        """Larger gap along the axes of the agent's box, and distance ahead.

        The gap is negative where boxes overlap. The axes of the neighbour's box are covered
        by the reverse pair.
        """
        cos, sin = direction.unbind()
        their_cos, their_sin = their_direction.unbind()
        ahead = torch.addcmul(x * cos, y, sin)
        aside = torch.addcmul(y * cos, x, sin, value=-1)
        straight = torch.addcmul(their_cos * cos, their_sin, sin).abs_()
        across = torch.addcmul(their_sin * cos, their_cos, sin, value=-1).abs_()
        length, width = self.half_size.unbind()
        their_length, their_width = self.near_half_size.unbind()
        reach = length + torch.addcmul(their_length * straight, their_width, across)
        side = width + torch.addcmul(their_length * across, their_width, straight)
        gap = torch.maximum(ahead.abs() - reach, aside.abs() - side)
        return gap, ahead

    def _seen(self, vectors: Float[Tensor, "2 V S G"]) -> Float[Tensor, "2 V S G K"]:
        """Vectors of the neighbours, turned to the frame of each agent."""
        # On tables of two axes, far faster than on others.
        theirs = vectors.flatten(0, -2).index_select(1, self.row)
        x, y = theirs.view(*vectors.shape[:-1], self.row.shape[0]).unbind()
        turned = [
            torch.addcmul(self.cos * x, self.sin, y, value=-1),
            torch.addcmul(self.cos * y, self.sin, x),
        ]
        return torch.stack(turned).unflatten(-1, (vectors.shape[-1], -1))


def _ways(points: Float[Tensor, "*N W"]) -> Float[Tensor, "*N W"]:
    """From each waypoint to the next, the first one from the agent's pose now."""
    apart = points.unflatten(-1, (2, -1))
    apart = torch.diff(apart, dim=-1, prepend=torch.zeros_like(apart[..., :1]))
    return apart.flatten(-2)


def _square_distance(
    x: Float[Tensor, "*shape"], y: Float[Tensor, "*shape"]
) -> Float[Tensor, "*shape"]:
    return x.square().add_(_LEAST_SQUARE).addcmul_(y, y)


def _closeness(
    x: Float[Tensor, "*shape"], y: Float[Tensor, "*shape"]
) -> Float[Tensor, "*shape"]:
    return _square_distance(x, y).sqrt_().add_(1).reciprocal_()
