"""Motion of agents as an affine function of their latents, with two derivatives.

In an agent's own frame, x at each step is a linear function of the first five latents
and y of the others, so that derivatives and least squares need tables only.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.analysis.metrics.motion import WINDOW_STEPS, derivative_operators
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.inputs import NUM_ALONG
from pd_editor.generation.trajectory.network.decoding import (
    STAYS_M,
    TrajectoryDecoder,
    jump_shares,
)
from pd_editor.scene.thresholds import MOVING_MPS, STANDING_MPS


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedMotion:
    """Predicted motion of A agents in S samples at T steps, the current one first.

    In the scene frame. Agents that are not sampled move as recorded.
    """

    position_m: Float[Tensor, "S A T 2"]
    velocity_mps: Float[Tensor, "S A T 2"]
    acceleration_mps2: Float[Tensor, "S A T 2"]
    heading_rad: Float[Tensor, "S A T"]
    """Direction of motion, constant while an agent is stationary."""
    size_m: Float[Tensor, "A 2"]
    """Length and width."""
    exists: Bool[Tensor, "A T"]
    is_sampled: Bool[Tensor, "A"]
    """Whether an agent's trajectory can be guided."""
    time_s: Float[Tensor, "T"]
    level: float
    """Noise level of the denoising step; 0 when the result is closed."""

    @property
    def num_samples(self) -> int:
        """Number of samples S."""
        return len(self.position_m)

    @property
    def step_s(self) -> float:
        """Time between two steps."""
        return float(self.time_s[1] - self.time_s[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownMotion:
    """Recorded motion of agents that are not sampled; anything where not known."""

    position_m: Float[Tensor, "A T 2"]
    velocity_mps: Float[Tensor, "A T 2"]
    heading_rad: Float[Tensor, "A T"]
    exists: Bool[Tensor, "A T"]
    is_known: Bool[Tensor, "A T"]


@dataclass(frozen=True, kw_only=True, eq=False)
class LatentMotion:
    """Tables that map latents of A agents to motion at T steps; axis 3: derivative."""

    matrix: Float[Tensor, "3 10 T"]
    """Share of each latent in x (first five) or y (others), in the agent's frame."""
    products: Float[Tensor, "3 T3 100"]
    """Products of the shares of pairs of latents: of x with x at all steps, then of x
    with y (both ways), then of y with y."""
    offset_m: Float[Tensor, "A 3 T"]
    """x at latents of zero."""
    origin_m: Float[Tensor, "A 2"]
    heading_rad: Float[Tensor, "A"]
    forward: Float[Tensor, "A 2"]
    speed_mps: Float[Tensor, "A"]
    size_m: Float[Tensor, "A 2"]
    is_sampled: Bool[Tensor, "A"]
    known: KnownMotion
    time_s: Float[Tensor, "T"]

    @classmethod
    def of(
        cls,
        decoder: TrajectoryDecoder,
        *,
        num_steps: int,
        origin_m: Float[Tensor, "A 2"],
        heading_rad: Float[Tensor, "A"],
        speed_mps: Float[Tensor, "A"],
        size_m: Float[Tensor, "A 2"],
        is_sampled: Bool[Tensor, "A"],
        known: KnownMotion,
    ) -> "LatentMotion":
        """Make the tables for the current step and ``num_steps`` later ones.

        Beyond the last step of the decoder, agents keep their last velocity.
        """
        count = decoder.num_steps
        steps = torch.arange(count, device=origin_m.device)
        matrix, mean, times = decoder.matrix(steps)
        step_s = float(decoder.get_buffer("step_s"))
        across = matrix[NUM_ALONG:, count:]
        shares = torch.cat([matrix[:NUM_ALONG, :count], across])
        jump = torch.as_tensor(jump_shares(count, step_s)).to(shares)
        shares, mean = (one - one[..., :3] @ jump for one in (shares, mean[:count]))
        shares, mean, times = (
            _at_steps(values, num_steps) for values in (shares, mean, times[:count])
        )
        table = _derivatives(shares, torch.zeros_like(shares[:, 0]), step_s)
        pace = _derivatives(times[None], torch.ones_like(times[:1]), step_s)
        base = _derivatives(mean[None], torch.zeros_like(mean[:1]), step_s)
        pairs = (table[:, :, None] * table[:, None]).flatten(1, 2).mT
        is_x = torch.arange(LATENT_SIZE, device=origin_m.device) < NUM_ALONG
        kind = (~is_x).long()[:, None] + (~is_x).long()
        products = [pairs * (kind.flatten() == one) for one in range(3)]
        return cls(
            matrix=table,
            products=torch.cat(products, dim=1),
            offset_m=base[:, 0] + speed_mps[:, None, None] * pace[:, 0],
            origin_m=origin_m,
            heading_rad=heading_rad,
            forward=torch.stack([heading_rad.cos(), heading_rad.sin()], dim=-1),
            speed_mps=speed_mps,
            size_m=size_m,
            is_sampled=is_sampled,
            known=known,
            time_s=step_s * torch.arange(num_steps + 1).to(origin_m),
        )

    def predicted(
        self, latent: Float[Tensor, "S A 10"], level: float
    ) -> PredictedMotion:
        """Motion of all agents at predicted latents."""
        steps = self.matrix.shape[-1]
        tables = self.matrix.transpose(0, 1).flatten(1)
        x, y = (latent[..., :NUM_ALONG], latent[..., NUM_ALONG:])
        x = (x @ tables[:NUM_ALONG]).unflatten(-1, (3, steps)) + self.offset_m
        y = (y @ tables[NUM_ALONG:]).unflatten(-1, (3, steps))
        forward = self.forward[:, None, None]
        left = torch.stack([-forward[..., 1], forward[..., 0]], dim=-1)
        points = x[..., None] * forward + y[..., None] * left
        if level == 0:
            points = torch.where(self._stays(points)[..., None, None], 0.0, points)
        known = self.known
        where = known.is_known[..., None]
        position = points[:, :, 0] + self.origin_m[:, None]
        position = torch.where(where, known.position_m, position)
        velocity = torch.where(where, known.velocity_mps, points[:, :, 1])
        heading = torch.where(
            known.is_known, known.heading_rad, self._heading(velocity)
        )
        return PredictedMotion(
            position_m=position,
            velocity_mps=velocity,
            acceleration_mps2=torch.where(where, 0.0, points[:, :, 2]),
            heading_rad=heading,
            size_m=self.size_m,
            exists=known.exists,
            is_sampled=self.is_sampled,
            time_s=self.time_s,
            level=level,
        )

    def _stays(self, points_m: Float[Tensor, "S A 3 T 2"]) -> Bool[Tensor, "S A 1"]:
        """Agents that the decoder keeps exactly at their positions."""
        reach = points_m[:, :, 0].norm(dim=-1).amax(dim=-1, keepdim=True)
        return (self.speed_mps[:, None] < STANDING_MPS) & (reach < STAYS_M)

    def _heading(
        self, velocity_mps: Float[Tensor, "S A T 2"]
    ) -> Float[Tensor, "S A T"]:
        """Direction of motion; while stationary, the last one."""
        x, y = velocity_mps.unbind(-1)
        course = torch.atan2(y, x)
        course[..., 0] = self.heading_rad
        moves = x.square() + y.square() > MOVING_MPS**2
        steps = torch.arange(course.shape[-1], device=course.device)
        last = torch.where(moves, steps, 0).cummax(dim=-1).values
        return course.gather(-1, last)


def _at_steps(
    values: Float[Tensor, "*shape H"], num_steps: int
) -> Float[Tensor, "*shape T"]:
    """Values at the current step, where no latent changes the position, and later."""
    rate = values[..., -1:] - values[..., -2:-1]
    beyond = torch.arange(1, num_steps - values.shape[-1] + 1, device=values.device)
    values = torch.cat([values, values[..., -1:] + rate * beyond], dim=-1)
    return torch.nn.functional.pad(values, (1, 0))


def _derivatives(
    values: Float[Tensor, "N T"], first_rate: Float[Tensor, "N"], step_s: float
) -> Float[Tensor, "3 N T"]:
    """Values with their first and second derivatives; the first rate is given.

    The second ones are those of the metrics, in which limits are told.
    """
    num_steps = values.shape[-1]
    rate = torch.empty_like(values)
    rate[:, 0] = first_rate
    rate[:, 1:-1] = (values[:, 2:] - values[:, :-2]) / (2 * step_s)
    rate[:, -1] = (values[:, -1] - values[:, -2]) / step_s
    _, second, _ = derivative_operators(num_steps, WINDOW_STEPS, step_s)
    fits = torch.from_numpy(second.copy()).to(values)
    return torch.stack([values, rate, values @ fits.mT])


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
        way = way.clamp_min(0.1)
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
