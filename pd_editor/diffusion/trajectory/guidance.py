"""Guidance of predicted clean trajectories to the nearest Frenet candidates.

At each step of the later part of sampling, each agent's prediction goes a part of the
way to the candidate nearest to it (Path Diffuser, section III-F, which leaves cost and
strength open). No gradient is needed: distances are those of latents in metres.
"""

from dataclasses import dataclass, field
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.core.config_limits import check_settings
from pd_editor.diffusion.core.noise_schedule import even_levels
from pd_editor.diffusion.defaults import (
    DEFAULT_WARPED_WEIGHT,
    DEFAULT_WEIGHT,
    NUM_STEPS,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.trajectory.denoiser import TrajectoryDenoiser
from pd_editor.diffusion.trajectory.features import STANDING_MPS


@dataclass(frozen=True, kw_only=True)
class TrajectoryGuidance:
    """How strongly predicted clean trajectories are changed, and from which level on."""

    weight: float = DEFAULT_WEIGHT
    """Share of the way to the candidate, unless a request says otherwise."""
    warped_weight: float = DEFAULT_WARPED_WEIGHT
    """The same where the road is warped."""
    is_last_step_guided: bool = field(default=False, metadata={"when_absent": True})
    """Whether the prediction of the last step, which is the result, is pulled too."""
    first_level: float = 0.7
    """Above this noise level nothing is changed."""
    standing_first_level: float = 0.35
    """The same of standing agents: few of them start, and pulled early on none would."""
    stays_m: float = 0.4
    """A trajectory as close to standing still as this counts as standing."""
    starting_share: float = 0.2
    """Of the pull on standing agents that are predicted to start: the nearest candidate
    that starts may be far. Pulled all the way, 6.1 instead of 4.9 % of the trajectories
    overlap, and their error is 0.93 instead of 0.89 of constant velocity's
    (``train``)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(kw_only=True, eq=False)
class NearestCandidateGuide:
    """Pulls the agents of B scenes to their nearest candidates.

    Standing agents that are predicted to stay are pulled to standing candidates only;
    those predicted to start are pulled a little, and only to moving candidates; both
    late. Agents without candidates are left alone.
    """

    config: TrajectoryGuidance = field(default_factory=TrajectoryGuidance)

    weight: Float[Tensor, "B A"]
    """Share of the way to the candidate that each step goes."""
    candidates: Float[Tensor, "B A C 10"]
    """In metres: latents times the scales of the basis."""
    allowed: Bool[Tensor, "B A C"]
    is_standing: Bool[Tensor, "B A"]
    stays: Bool[Tensor, "B A C"]
    """Candidates that stand still."""
    still: Float[Tensor, "B A 10"]
    """Standing still, in metres."""
    scale: Float[Tensor, "10"]
    """Metres of root mean square distance per unit of each latent."""
    last_level: float = 0.0
    """Noise level of the last step."""
    _last: tuple[Float[Tensor, "S B A 10"], Float[Tensor, "S B A"]] | None = field(
        default=None, init=False
    )
    """The ways to the candidates in metres, and which part of each the last pull went."""

    @classmethod
    def of(
        cls,
        model: TrajectoryDenoiser,
        scene: SceneTensors,
        weight: Float[Tensor, "B A"],
        config: TrajectoryGuidance | None = None,
        num_steps: int = NUM_STEPS,
    ) -> "NearestCandidateGuide":
        """A guide for the agents of a scene; the weight is 0 of those left alone."""
        config = TrajectoryGuidance() if config is None else config
        decoder = model.decoder
        scale = decoder.get_buffer("scale_m") / decoder.num_steps**0.5
        candidates = scene.candidates * scale
        still = decoder.still(scene.agent_speed) * scale
        stays = (candidates - still[:, :, None]).norm(dim=-1) < config.stays_m
        return cls(
            config=config,
            weight=weight,
            candidates=candidates,
            allowed=scene.has_candidate,
            is_standing=scene.agent_speed < STANDING_MPS,
            stays=stays & scene.has_candidate,
            still=still,
            scale=scale,
            last_level=even_levels(num_steps)[-1],
        )

    def __call__(
        self, clean: Float[Tensor, "S B A 10"], level: float
    ) -> Float[Tensor, "S B A 10"]:
        """Predicted clean latents, nearer to candidates."""
        if level > self.config.first_level:
            return clean
        if level <= self.last_level and not self.config.is_last_step_guided:
            return clean
        predicted = clean * self.scale
        stays = self.is_standing
        if self._is_any_agent_stationary:
            stays = stays & (
                (predicted - self.still).norm(dim=-1) < self.config.stays_m
            )
        nearest, exists = self._nearest(predicted, stays)
        pull = torch.where(exists, self.weight, 0.0)
        if self._is_any_agent_stationary:
            late = level <= self.config.standing_first_level
            share = torch.where(stays, 1.0, self.config.starting_share) * late
            pull = torch.where(self.is_standing, share * pull, pull)
        way = nearest - predicted
        self._last = way, pull
        return torch.addcmul(clean, way, pull[..., None] / self.scale)

    def cost_m(self) -> tuple[float, float]:
        """Mean distance of guided agents to candidates before and after the last pull."""
        if self._last is None:
            return 0.0, 0.0
        way, pull = self._last
        guided = pull > 0
        before = way.norm(dim=-1)[guided]
        after = before * (1 - pull[guided])
        count = max(len(before), 1)
        return float(before.sum()) / count, float(after.sum()) / count

    def _nearest(
        self, predicted: Float[Tensor, "S B A 10"], stays: Bool[Tensor, "*S B A"]
    ) -> tuple[Float[Tensor, "S B A 10"], Bool[Tensor, "S B A"]]:
        """Nearest allowed candidates, and whether there is one."""
        cost, exists = self._of_going
        if self._is_any_agent_stationary:
            cost = torch.where(stays[..., None], self._of_staying[0], cost)
            exists = torch.where(stays, self._of_staying[1], exists)
        # The square of the distance, but for what is the same for all candidates.
        product = (self.candidates @ predicted[..., None])[..., 0]
        best = torch.sub(cost, product, alpha=2).argmin(dim=-1)
        index = best[..., None, None].expand(*best.shape, 1, predicted.shape[-1])
        table = self.candidates.expand(len(predicted), *self.candidates.shape)
        return table.gather(-2, index)[..., 0, :], exists.expand(best.shape)

    @cached_property
    def _is_any_agent_stationary(self) -> bool:
        return bool(self.is_standing.any())

    @cached_property
    def _of_going(self) -> tuple[Float[Tensor, "B A C"], Bool[Tensor, "B A"]]:
        return self._allowing(
            self.allowed & ~(self.is_standing[..., None] & self.stays)
        )

    @cached_property
    def _of_staying(self) -> tuple[Float[Tensor, "B A C"], Bool[Tensor, "B A"]]:
        return self._allowing(self.stays)

    def _allowing(
        self, some: Bool[Tensor, "B A C"]
    ) -> tuple[Float[Tensor, "B A C"], Bool[Tensor, "B A"]]:
        """Squares of their lengths, infinite of others; who has one of them at all."""
        squares = self.candidates.square().sum(dim=-1)
        return squares.masked_fill(~some, torch.inf), some.any(dim=-1)
