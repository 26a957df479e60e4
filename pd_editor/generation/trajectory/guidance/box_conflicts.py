"""Conflicts of boxes: how deep they overlap, and who could be where at what time."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion

_LEAST_WAY_M: Final = 0.1


def depth_m(
    offset_m: Float[Tensor, "*N 2"],
    heading_rad: tuple[Float[Tensor, "*#N"], Float[Tensor, "*#N"]],
    size_m: tuple[Float[Tensor, "*#N 2"], Float[Tensor, "*#N 2"]],
    margin_m: tuple[Float[Tensor, "*#N"], Float[Tensor, "*#N"]] | None = None,
) -> Float[Tensor, "*N"]:
    """Depth to which boxes overlap; negative: apart along one of the separating axes.

    Args:
        offset_m: centre of the second box relative to the first.
        heading_rad: of both boxes.
        size_m: of both boxes.
        margin_m: wanted gaps along and across each box.
    """
    turn = heading_rad[1] - heading_rad[0]
    turned = turn.cos().abs(), turn.sin().abs()
    depths: list[Tensor] = []
    for heading, sizes in (
        (heading_rad[0], size_m),
        (heading_rad[1], (size_m[1], size_m[0])),
    ):
        ahead, aside, length, width = beside_m(offset_m, heading, turned, sizes)
        if margin_m is not None:
            length, width = length + margin_m[0], width + margin_m[1]
        depths.append(torch.minimum(length - ahead.abs(), width - aside.abs()))
    return torch.minimum(depths[0], depths[1])


def beside_m(
    offset_m: Float[Tensor, "*N 2"],
    heading_rad: Float[Tensor, "*#N"],
    turned: tuple[Float[Tensor, "*#N"], Float[Tensor, "*#N"]],
    size_m: tuple[Float[Tensor, "*#N 2"], Float[Tensor, "*#N 2"]],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Way ahead and to the left to another box, and where it is within the reach of both.

    Args:
        offset_m: its centre relative to that of the first box.
        heading_rad: of the first box.
        turned: absolute cosine and sine of the difference of the headings.
        size_m: of the first and of the other box.
    """
    x, y = heading_rad.cos(), heading_rad.sin()
    (cos, sin), (own, other) = turned, size_m
    return (
        offset_m[..., 0] * x + offset_m[..., 1] * y,
        offset_m[..., 1] * x - offset_m[..., 0] * y,
        (own[..., 0] + other[..., 0] * cos + other[..., 1] * sin) / 2,
        (own[..., 1] + other[..., 0] * sin + other[..., 1] * cos) / 2,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxTracks:
    """Boxes of A agents in S samples at the current step and at every third later one."""

    step: Int[Tensor, "K"]
    """Index of each compared step."""
    position_m: Float[Tensor, "S A K 2"]
    heading_rad: Float[Tensor, "S A K"]
    exists: Bool[Tensor, "A K"]
    time_s: Float[Tensor, "K"]
    size_m: Float[Tensor, "A 2"]
    along_m: Float[Tensor, "S A K"]
    """Way that each agent has driven."""
    speed_mps: Float[Tensor, "S A"]
    """At the current step."""
    braked: Int[Tensor, "S A K"]
    """Step of the own path that an agent at least reaches by each step if it brakes."""

    @classmethod
    def of(cls, motion: PredictedMotion, braking_mps2: float) -> "BoxTracks":
        """The boxes of a prediction."""
        count = motion.position_m.shape[2]
        # Boxes are compared at every third step.
        later = torch.arange(count - 1, 0, -3, device=motion.size_m.device).flip(0)
        step = torch.nn.functional.pad(later, (1, 0))
        position, time = motion.position_m[:, :, step], motion.time_s[step]
        along = position.diff(dim=2).norm(dim=-1).cumsum(dim=-1)
        speed = motion.velocity_mps[:, :, :1].norm(dim=-1)
        lasts = time.minimum(speed / braking_mps2)
        least = speed * lasts - braking_mps2 / 2 * lasts.square()
        along = torch.nn.functional.pad(along, (1, 0)).contiguous()
        return cls(
            step=step,
            position_m=position,
            heading_rad=motion.heading_rad[:, :, step],
            exists=motion.exists[:, step],
            time_s=time,
            size_m=motion.size_m,
            along_m=along,
            speed_mps=speed[..., 0],
            braked=torch.searchsorted(along, least.contiguous()).clamp_max(
                len(step) - 1
            ),
        )

    def pairs_that_meet(
        self, counts: Bool[Tensor, "A A"]
    ) -> tuple[Int[Tensor, "P"], Int[Tensor, "P"], Int[Tensor, "P"]]:
        """Samples and pairs of agents whose swept discs have bounds that intersect."""
        radius = self.size_m.norm(dim=-1, keepdim=True) / 2
        gone = ~self.exists[..., None]
        low = self.position_m.masked_fill(gone, torch.inf).amin(dim=2) - radius
        high = self.position_m.masked_fill(gone, -torch.inf).amax(dim=2) + radius
        meets = (low[:, :, None] < high[:, None]) & (high[:, :, None] > low[:, None])
        sample, one, two = (meets.all(dim=-1) & counts.triu(1)).nonzero(as_tuple=True)
        return sample, one, two

    def braking_mps2(
        self, sample: Int[Tensor, "P"], own: Int[Tensor, "P"], last: Int[Tensor, "P K"]
    ) -> Float[Tensor, "P"]:
        """Constant braking that keeps agents from going beyond steps of their paths.

        ``last`` is that step at each compared one; K where an agent is unhindered.
        """
        count = len(self.step)
        way = self.along_m[sample, own].gather(1, last.clamp(0, count - 1))
        way = way.clamp_min(_LEAST_WAY_M)
        speed, time = self.speed_mps[sample, own][:, None], self.time_s
        slows = 2 * (speed * time - way) / time.square().clamp_min(0.01)
        braking = torch.where(2 * way < speed * time, speed.square() / (2 * way), slows)
        return (braking.clamp_min(0.0) * (last < count)).amax(dim=-1)

    def blocked(
        self,
        sample: Int[Tensor, "P"],
        own: Int[Tensor, "P"],
        other: Int[Tensor, "P"],
        margin_m: tuple[Float[Tensor, "P"], Float[Tensor, "P"]],
    ) -> Bool[Tensor, "P K K"]:
        """Which places of an agent's path, given by their step, are blocked at each step."""
        position = self.position_m[sample, own], self.position_m[sample, other]
        heading = self.heading_rad[sample, own], self.heading_rad[sample, other]
        depth = depth_m(
            position[1][:, None] - position[0][:, :, None],
            (heading[0][:, :, None], heading[1][:, None]),
            (self.size_m[own][:, None, None], self.size_m[other][:, None, None]),
            (margin_m[0][:, None, None], margin_m[1][:, None, None]),
        )
        there = self.exists[own][:, :, None] & self.exists[other][:, None]
        return (depth > 0) & there
