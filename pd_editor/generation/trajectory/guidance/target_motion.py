"""Target motions along curves: what terms on paths and speeds ask for at each step."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    GuidedAgents,
    ResidualRows,
    row_weights,
)
from pd_editor.scene.paths.driving_paths import SPACING_M

_NUM_COMPARED: Final = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Curves of G agents in S samples, each of N nodes; straight on beyond the last."""

    node: Float[Tensor, "#S G N 5"]
    """Position, direction and arc length, which does not decrease."""

    @classmethod
    def of(
        cls,
        points_m: Float[Tensor, "#S G N 2"],
        direction: Float[Tensor, "#S G N 2"],
        along_m: Float[Tensor, "#S G N"],
    ) -> "Curves":
        """Curves of nodes."""
        return cls(node=torch.cat([points_m, direction, along_m[..., None]], dim=-1))

    @property
    def points_m(self) -> Float[Tensor, "#S G N 2"]:
        """Positions of the nodes."""
        return self.node[..., :2]

    @property
    def direction(self) -> Float[Tensor, "#S G N 2"]:
        """Directions at the nodes."""
        return self.node[..., 2:4]

    @property
    def along_m(self) -> Float[Tensor, "#S G N"]:
        """Arc lengths of the nodes."""
        return self.node[..., 4]

    def at(
        self, along_m: Float[Tensor, "S G T"]
    ) -> tuple[Float[Tensor, "S G T 2"], Float[Tensor, "S G T 2"]]:
        """Points and directions at arc lengths."""
        end = self.along_m[..., -1:]
        between = self.between(along_m.clamp_min(0.0).minimum(end))
        direction = torch.nn.functional.normalize(between[..., 2:4], dim=-1)
        beyond = (along_m - end).clamp_min(0.0)[..., None]
        return between[..., :2] + beyond * direction, direction

    def between(self, along_m: Float[Tensor, "S G T"]) -> Float[Tensor, "S G T 5"]:
        """Nodes interpolated at arc lengths within the curves."""
        table = self.along_m.expand(len(along_m), -1, -1).contiguous()
        after = torch.searchsorted(table, along_m.contiguous(), right=True)
        after = after.clamp_(1, table.shape[-1] - 1)
        low, high = _nodes(self.node, after - 1), _nodes(self.node, after)
        length = (high[..., 4] - low[..., 4]).clamp_min(1e-4)
        share = ((along_m - low[..., 4]) / length).clamp_(0, 1)
        return torch.lerp(low, high, share[..., None])

    def nearest(
        self, point_m: Float[Tensor, "*#S #G 2"]
    ) -> tuple[Float[Tensor, "#S G"], Float[Tensor, "#S G"]]:
        """Arc length and left offset of the point of each curve nearest to its point."""
        gap = point_m[..., None, :] - self.points_m
        node = gap.square().sum(-1).argmin(dim=-1, keepdim=True)
        x, y, ahead_x, ahead_y, along = _nodes(self.node, node)[..., 0, :].unbind(-1)
        x, y = point_m[..., 0] - x, point_m[..., 1] - y
        return along + x * ahead_x + y * ahead_y, ahead_x * y - ahead_y * x


def predicted_curves(motion: PredictedMotion, agents: Int[Tensor, "G"]) -> Curves:
    """Predicted paths as curves; what is driven backwards does not count."""
    points = motion.position_m[:, agents]
    heading = motion.heading_rad[:, agents]
    direction = torch.stack([heading.cos(), heading.sin()], dim=-1)
    step = (points.diff(dim=-2) * direction[..., 1:, :]).sum(-1).clamp_min_(0.0)
    along = torch.nn.functional.pad(step.cumsum(dim=-1), (1, 0))
    return Curves.of(points, direction, along)


def extended(curves: Curves, guided: GuidedAgents) -> Curves:
    """Curves that go on along the planned path that is nearest to each of them."""
    planned, exists = guided.planned
    agent = torch.arange(len(planned), device=planned.device)[:, None]
    most = planned.shape[-2] - 1
    last = curves.node[..., -1:, :]
    end = last[..., 4]
    share = torch.arange(1, _NUM_COMPARED + 1).to(end) / _NUM_COMPARED
    places = end * share
    compared = curves.between(places)[..., :2]
    node = (places / SPACING_M).round().long().clamp_max_(most)
    path = torch.arange(planned.shape[1], device=planned.device)
    others = planned[agent[..., None], path[:, None], node[:, :, None]]
    gap = (others - compared[:, :, None]).norm(dim=-1).mean(dim=-1)
    best = gap.masked_fill_(~exists, torch.inf).argmin(dim=-1)
    # So many points, one every ``SPACING_M``, extend a predicted path.
    further = torch.arange(45 + 1, device=planned.device)
    node = ((end / SPACING_M).ceil().long() + further).clamp_max_(most)
    points = planned[agent, best[..., None], node]
    # The remainder begins where the curve ends.
    points = points + (last[..., :2] - points[..., :1, :])
    step = points.diff(dim=-2)
    length = step.norm(dim=-1)
    direction = torch.where(
        length[..., None] > 0.01,
        torch.nn.functional.normalize(step, dim=-1),
        last[..., 2:4],
    )
    more = Curves.of(points[..., 1:, :], direction, end + length.cumsum(dim=-1))
    return Curves(node=torch.cat([curves.node, more.node], dim=-2))


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetMotion:
    """Where G agents should be at each step, and in which direction they drive there."""

    agents: Int[Tensor, "G"]
    position_m: Float[Tensor, "S G T 2"]
    direction: Float[Tensor, "S G T 2"]
    speed_mps: Float[Tensor, "S G T"]

    @classmethod
    def along(
        cls,
        agents: Int[Tensor, "G"],
        curves: Curves,
        along_m: Float[Tensor, "S G T"],
        step_s: float,
    ) -> "TargetMotion":
        """Motion along curves, given the arc length at each step."""
        position, direction = curves.at(along_m)
        rate = along_m.diff(dim=-1) / step_s
        middle = (rate[..., 1:] + rate[..., :-1]) / 2
        return cls(
            agents=agents,
            position_m=position,
            direction=direction,
            speed_mps=torch.cat([rate[..., :1], middle, rate[..., -1:]], dim=-1),
        )

    def rows(
        self,
        *,
        along_m: float,
        across_m: float,
        speed_mps: float | None = None,
        strength: Float[Tensor, "G 1"],
        is_wanted: Bool[Tensor, "S G #T"],
    ) -> Sequence[ResidualRows]:
        """Residuals along and across, and of velocities, with accepted deviations."""
        ahead = self.direction
        left = torch.stack([-ahead[..., 1], ahead[..., 0]], dim=-1)
        asked = [
            (0, ahead, (ahead * self.position_m).sum(-1), along_m),
            (0, left, (left * self.position_m).sum(-1), across_m),
        ]
        if speed_mps is not None:
            asked.append((1, ahead, self.speed_mps, speed_mps))
            # Where little is left of the speed, a small drift aside would turn the agent.
            asked.append((1, left, torch.zeros_like(self.speed_mps), speed_mps))
        return [
            ResidualRows(
                agents=self.agents,
                order=order,
                direction=direction,
                target=target,
                weight=torch.where(
                    is_wanted, row_weights(accepted, strength, target), 0.0
                ),
            )
            for order, direction, target, accepted in asked
        ]


def speeds(
    along_m: Float[Tensor, "S G T"], first_mps: Float[Tensor, "#S G"], step_s: float
) -> Float[Tensor, "S G T"]:
    """Speeds in the step before each; the first one is given."""
    later = along_m.diff(dim=-1) / step_s
    return torch.cat([first_mps[..., None].expand(*later.shape[:2], 1), later], dim=-1)


def distances(
    speed_mps: Float[Tensor, "S G T"], step_s: float
) -> Float[Tensor, "S G T"]:
    """Arc lengths of speeds; inverse of ``speeds``."""
    later = speed_mps[..., 1:].cumsum(dim=-1) * step_s
    return torch.nn.functional.pad(later, (1, 0))


def braked_in_time(
    speed_mps: Float[Tensor, "S G T"],
    braking_mps2: float,
    step_s: float,
) -> Float[Tensor, "S G T"]:
    """Speeds that brake at most so hard, and early enough for the later ones."""
    count = speed_mps.shape[-1]
    lost = braking_mps2 * step_s * torch.arange(count).to(speed_mps)
    later = (speed_mps + lost).flip(-1).cummin(dim=-1).values.flip(-1)
    possible = later - lost
    # The current speed is given: from it on, braking takes its time.
    return torch.maximum(possible, (speed_mps[..., :1] - lost).clamp_min(0.0))


def _nodes(
    table: Float[Tensor, "#S G N D"], node: Int[Tensor, "S G K"]
) -> Float[Tensor, "S G K D"]:
    table = table.expand(len(node), *table.shape[1:])
    return table.gather(-2, node[..., None].expand(*node.shape, table.shape[-1]))
