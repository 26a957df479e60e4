"""Interaction features: neighbours at predicted waypoints, in each agent's frame."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from pd_editor.diffusion.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.diffusion.trajectory.network.features import Neighbors

NUM_WAYPOINTS: Final = 8
NUM_WAYPOINT_FEATURES: Final = 3 * NUM_WAYPOINTS
NUM_GAP_FEATURES: Final = 2 * NUM_WAYPOINTS

_NEAR_M: Final = 4.0
"""Distance at which closeness is one half."""
_LEAST_SQUARE: Final = 1e-6 / _NEAR_M**2
_HELD: Final = 0.2 / _NEAR_M
"""An agent that moves less between two waypoints keeps its heading."""
_GAP_SCALE: Final = 2.0
"""Gaps are clamped to this: 2 m in units of 4 m scaled features."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InteractionGeometry:
    """Geometry of the waypoints of G agents and their K neighbours, without latents.

    Lengths are in units of 4 m; W = 2 * 8 coordinates, all x before all y.
    """

    matrix: Float[Tensor, "10 W3"]
    """Latents to waypoints, to the same turned by 90 degrees, and to the ways to each
    waypoint from the one before."""
    offset: Float[Tensor, "G W3"]
    row: Int[Tensor, "R"]
    cos: Float[Tensor, "R 1"]
    sin: Float[Tensor, "R 1"]
    """Sine of the neighbour's heading in the agent's frame."""
    position: Float[Tensor, "R W"]
    """Position of the neighbour in the agent's frame."""
    half_size: Float[Tensor, "G 1 1 2"]
    """Half the length and half the width of each agent."""
    near_half_size: Float[Tensor, "G K 1 2"]
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
        x, y, cos, sin = neighbors.pose.flatten(0, 2)[..., None].unbind(-2)
        place = [one.expand(-1, NUM_WAYPOINTS) for one in (x, y)]
        row = neighbors.row_of_all()
        half_size = size_m.flatten(0, 1) * (0.5 / _NEAR_M)
        held = torch.zeros_like(offset[:1])
        held[:, :NUM_WAYPOINTS] = _HELD
        matrix, offset = matrix / _NEAR_M, offset / _NEAR_M
        return cls(
            matrix=torch.cat([_with_quarter_turn(matrix), _ways(matrix)], dim=-1),
            offset=torch.cat(
                [_with_quarter_turn(offset), _ways(offset) + held], dim=-1
            ),
            row=row.flatten(),
            cos=cos.contiguous(),
            sin=sin.contiguous(),
            position=torch.cat(place, dim=1) / _NEAR_M,
            half_size=half_size[:, None, None],
            near_half_size=half_size[row.flatten(0, 1)][:, :, None],
        )

    def features(
        self, latent: Float[Tensor, "S B A 10"], *, with_gaps: bool
    ) -> Float[Tensor, "S R F"]:
        """Offsets dampened with distance, and closeness, at each waypoint.

        With gaps, also the gap between the boxes, and the distance to the neighbour along
        the agent's own path.
        """
        found = latent.flatten(1, 2) @ self.matrix + self.offset
        sizes = [4 * NUM_WAYPOINTS, 2 * NUM_WAYPOINTS]
        points, way = found.split(sizes, dim=-1)
        own, turned = points.chunk(2, dim=-1)
        position, direction = self.position, None
        if with_gaps:
            # Directions are rotated together with points.
            direction = _directions(way)
            ahead = _with_quarter_turn(direction).chunk(2, dim=-1)
            points = torch.cat([own, ahead[0], turned, ahead[1]], dim=-1)
            position = nn.functional.pad(position, (0, position.shape[1]))
        theirs = self._seen(points, position)
        x, y = (theirs[..., : own.shape[-1]] - own[:, :, None]).chunk(2, dim=-1)
        distance = torch.addcmul(x.square() + _LEAST_SQUARE, y, y).sqrt()
        closeness = 1 / (distance + 1)
        found = [x * closeness, y * closeness, closeness]
        if direction is not None:
            gap, ahead = self._gaps(direction, theirs[..., own.shape[-1] :], x, y)
            found += [torch.tanh(_GAP_SCALE * gap), ahead * closeness]
        return torch.cat(found, dim=-1).flatten(1, 2)

    def _gaps(
        self,
        direction: Float[Tensor, "S G W"],
        their_direction: Float[Tensor, "S G K W"],
        x: Float[Tensor, "S G K N"],
        y: Float[Tensor, "S G K N"],
    ) -> tuple[Float[Tensor, "S G K N"], Float[Tensor, "S G K N"]]:
        """Larger gap along the axes of the agent's box, and distance ahead.

        The gap is negative where boxes overlap. The axes of the neighbour's box are covered
        by the reverse pair.
        """
        cos, sin = direction[:, :, None].chunk(2, dim=-1)
        their_cos, their_sin = their_direction.chunk(2, dim=-1)
        ahead = torch.addcmul(x * cos, y, sin)
        aside = torch.addcmul(y * cos, x, sin, value=-1)
        straight = torch.addcmul(their_cos * cos, their_sin, sin).abs()
        across = torch.addcmul(their_sin * cos, their_cos, sin, value=-1).abs()
        length, width = self.half_size.unbind(-1)
        their_length, their_width = self.near_half_size.unbind(-1)
        reach = length + torch.addcmul(their_length * straight, their_width, across)
        side = width + torch.addcmul(their_length * across, their_width, straight)
        gap = torch.maximum(ahead.abs() - reach, aside.abs() - side)
        return gap, ahead

    def _seen(
        self, of_agents: Float[Tensor, "S G V2"], origin: Float[Tensor, "R V"]
    ) -> Float[Tensor, "S G K V"]:
        """Vectors of the neighbours in the frame of each agent, from an origin."""
        theirs, turned = of_agents.index_select(1, self.row).chunk(2, dim=-1)
        theirs = torch.addcmul(origin, self.cos, theirs)
        theirs = torch.addcmul(theirs, self.sin, turned)
        return theirs.unflatten(1, (len(self.offset), -1))


def _ways(points: Float[Tensor, "*N W"]) -> Float[Tensor, "*N W"]:
    """From each waypoint to the next, the first one from the agent's pose now."""
    apart = points.unflatten(-1, (2, -1))
    apart = torch.diff(apart, dim=-1, prepend=torch.zeros_like(apart[..., :1]))
    return apart.flatten(-2)


def _directions(ways: Float[Tensor, "S G W"]) -> Float[Tensor, "S G W"]:
    """Unit vectors of the ways between waypoints."""
    x, y = ways.chunk(2, dim=-1)
    scale = torch.addcmul(x.square() + _LEAST_SQUARE, y, y).rsqrt()
    return (ways.unflatten(-1, (2, -1)) * scale[..., None, :]).flatten(-2)


def _with_quarter_turn(points: Float[Tensor, "*N W"]) -> Float[Tensor, "*N W2"]:
    """All x, all y, then both rotated by 90 degrees to the left."""
    x, y = points.chunk(2, dim=-1)
    return torch.cat([points, -y, x], dim=-1)
