"""Target motions along curves: what terms on paths and speeds ask for at each step."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.diffusion.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.diffusion.trajectory.guidance.trajectory_term import (
    ResidualRows,
    TermContext,
    row_weights,
)
from pd_editor.paths.driving_paths import SPACING_M

_NUM_FURTHER: int = 45
"""Points, one every ``SPACING_M``, that extend a predicted path."""
_NUM_COMPARED: int = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Curves of G agents in S samples, each of N nodes; straight on beyond the last."""

    points_m: Float[Tensor, "#S G N 2"]
    along_m: Float[Tensor, "#S G N"]
    """Arc length at each node, not decreasing."""
    direction: Float[Tensor, "#S G N 2"]

    def at(
        self, along_m: Float[Tensor, "S G T"]
    ) -> tuple[Float[Tensor, "S G T 2"], Float[Tensor, "S G T 2"]]:
        """Points and directions at arc lengths."""
        table = self.along_m.expand(along_m.shape[0], -1, -1).contiguous()
        end = table[..., -1:]
        inside = along_m.clamp_min(0.0).minimum(end).contiguous()
        after = torch.searchsorted(table, inside, right=True)
        after = after.clamp(1, table.shape[-1] - 1)
        low, high = table.gather(-1, after - 1), table.gather(-1, after)
        share = ((inside - low) / (high - low).clamp_min(1e-4)).clamp(0, 1)[..., None]
        one = _nodes(self.points_m, after - 1)
        other = _nodes(self.points_m, after)
        direction = torch.lerp(
            _nodes(self.direction, after - 1), _nodes(self.direction, after), share
        )
        direction = torch.nn.functional.normalize(direction, dim=-1)
        beyond = (along_m - end).clamp_min(0.0)[..., None]
        return torch.lerp(one, other, share) + beyond * direction, direction

    def nearest(
        self, point_m: Float[Tensor, "2"]
    ) -> tuple[Float[Tensor, "#S G"], Float[Tensor, "#S G"]]:
        """Arc length and left offset of the point of each curve nearest to a point."""
        gap = point_m - self.points_m
        node = gap.square().sum(-1).argmin(dim=-1, keepdim=True)
        gap = _nodes(gap, node)[..., 0, :]
        direction = _nodes(self.direction, node)[..., 0, :]
        along = self.along_m.gather(-1, node)[..., 0] + (gap * direction).sum(-1)
        left = direction[..., 0] * gap[..., 1] - direction[..., 1] * gap[..., 0]
        return along, left


def predicted_curves(motion: PredictedMotion, agents: Int[Tensor, "G"]) -> Curves:
    """Predicted paths as curves; what is driven backwards does not count."""
    points = motion.position_m[:, agents]
    heading = motion.heading_rad[:, agents]
    direction = torch.stack([heading.cos(), heading.sin()], dim=-1)
    step = (points.diff(dim=-2) * direction[..., 1:, :]).sum(-1).clamp_min(0.0)
    along = torch.nn.functional.pad(step.cumsum(dim=-1), (1, 0))
    return Curves(points_m=points, along_m=along, direction=direction)


def extended(curves: Curves, context: TermContext, agents: Int[Tensor, "G"]) -> Curves:
    """Curves that go on along the planned path that is nearest to each of them."""
    planned, exists = context.planned(agents)
    last = planned.shape[-2] - 1
    end = curves.along_m[..., -1]
    share = torch.arange(1, _NUM_COMPARED + 1).to(end) / _NUM_COMPARED
    places = end[..., None] * share
    compared, _ = curves.at(places)
    node = (places / SPACING_M).round().long().clamp_max(last)
    others = _of_paths(planned, node)
    gap = (others - compared[:, :, None]).norm(dim=-1).mean(dim=-1)
    best = gap.masked_fill(~exists, torch.inf).argmin(dim=-1)
    path = planned.expand(len(best), *planned.shape)
    index = best[..., None, None, None].expand(*best.shape, 1, *planned.shape[-2:])
    path = path.gather(2, index)[:, :, 0]
    first = (end / SPACING_M).ceil().long()
    further = torch.arange(_NUM_FURTHER + 1, device=end.device)
    node = (first[..., None] + further).clamp_max(last)
    points = _nodes(path, node)
    # The remainder begins where the curve ends.
    shift = curves.points_m[..., -1:, :] - points[..., :1, :]
    points = points + shift
    step = points.diff(dim=-2)
    length = step.norm(dim=-1)
    along = end[..., None] + length.cumsum(dim=-1)
    known = torch.nn.functional.normalize(step, dim=-1)
    before = curves.direction[..., -1:, :]
    direction = torch.where(length[..., None] > 0.01, known, before)
    return Curves(
        points_m=torch.cat([curves.points_m, points[..., 1:, :]], dim=-2),
        along_m=torch.cat([curves.along_m, along], dim=-1),
        direction=torch.cat([curves.direction, direction], dim=-2),
    )


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
        strength: float,
        is_wanted: Bool[Tensor, "S G #T"],
    ) -> Sequence[ResidualRows]:
        """Residuals along and across, and of speeds, with accepted deviations."""
        ahead = self.direction
        left = torch.stack([-ahead[..., 1], ahead[..., 0]], dim=-1)
        asked = [
            (0, ahead, (ahead * self.position_m).sum(-1), along_m),
            (0, left, (left * self.position_m).sum(-1), across_m),
        ]
        if speed_mps is not None:
            asked.append((1, ahead, self.speed_mps, speed_mps))
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
    speed_mps: Float[Tensor, "S G T"], braking_mps2: float, step_s: float
) -> Float[Tensor, "S G T"]:
    """Speeds that brake at most so hard, and early enough for the later ones."""
    count = speed_mps.shape[-1]
    lost = braking_mps2 * step_s * torch.arange(count).to(speed_mps)
    later = (speed_mps + lost).flip(-1).cummin(dim=-1).values.flip(-1)
    possible = later - lost
    # The current speed is given: from it on, braking takes its time.
    return torch.maximum(possible, (speed_mps[..., :1] - lost).clamp_min(0.0))


def accelerated_in_time(
    speed_mps: Float[Tensor, "S G T"], acceleration_mps2: float, step_s: float
) -> Float[Tensor, "S G T"]:
    """Speeds that accelerate at most so hard."""
    count = speed_mps.shape[-1]
    gained = acceleration_mps2 * step_s * torch.arange(count).to(speed_mps)
    return (speed_mps - gained).cummin(dim=-1).values + gained


def _nodes(
    table: Float[Tensor, "#S G N 2"], node: Int[Tensor, "S G K"]
) -> Float[Tensor, "S G K 2"]:
    table = table.expand(len(node), *table.shape[1:])
    return table.gather(-2, node[..., None].expand(*node.shape, 2))


def _of_paths(
    planned: Float[Tensor, "G P M 2"], node: Int[Tensor, "S G K"]
) -> Float[Tensor, "S G P K 2"]:
    """Points of all planned paths at some nodes."""
    samples, agents, count = node.shape
    paths = planned.shape[1]
    table = planned.expand(samples, *planned.shape)
    index = node[:, :, None, :, None].expand(samples, agents, paths, count, 2)
    return table.gather(3, index)
