"""Guidance of predicted clean trajectories to the nearest Frenet candidates.

At low noise levels, each step moves each agent's prediction towards its nearest candidate
(Path Diffuser, section III-F, which does not specify cost and strength). No gradient is
needed: distances are those of latents in metres.
"""

from dataclasses import dataclass, field
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.generation.core.noise_schedule import even_levels
from pd_editor.generation.defaults import (
    DEFAULT_WARPED_WEIGHT,
    DEFAULT_WEIGHT,
    NUM_STEPS,
    check_settings,
)
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.scene.thresholds import STANDING_MPS


@dataclass(frozen=True, kw_only=True)
class TrajectoryGuidance:
    """Strengths and noise levels of the guidance of predicted clean trajectories."""

    weight: float = DEFAULT_WEIGHT
    """Default share of the distance to the candidate that each step moves."""
    warped_weight: float = DEFAULT_WARPED_WEIGHT
    """The same on warped roads."""
    last_step_share: float = 0.0
    """Factor of the weight in the last step, whose prediction is the result."""
    first_level: float = 0.7
    """There is no guidance above this noise level; above half of it, none of stationary
    agents: few of them start, and with early guidance none."""
    stays_m: float = 0.4
    """A trajectory within this distance of standstill counts as stationary."""
    starting_share: float = 0.2
    """Factor of the guidance of stationary agents that are predicted to start, whose
    nearest moving candidate may be far."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class NearestCandidateGuide:
    """Guides the agents of B scenes to their nearest candidates.

    Stationary agents that are predicted to stay are guided to stationary candidates only;
    those predicted to start are guided weakly, and only to moving candidates; both at low
    noise. Agents without candidates are not guided.
    """

    config: TrajectoryGuidance = field(default_factory=TrajectoryGuidance)

    weight: Float[Tensor, "B A"]
    """Share of the distance to the candidate that each step moves."""
    candidates: Float[Tensor, "B A C 10"]
    """Candidates in metres: latents times the scales of the basis."""
    allowed: Bool[Tensor, "B A C"]
    is_standing: Bool[Tensor, "B A"]
    stays: Bool[Tensor, "B A C"]
    """Stationary candidates."""
    still: Float[Tensor, "B A 10"]
    """Latents of standstill, in metres."""
    scale: Float[Tensor, "10"]
    """Metres of root mean square distance per unit of each latent."""
    last_level: float = 0.0
    """Noise level of the last step."""

    @classmethod
    def of(
        cls,
        decoder: TrajectoryDecoder,
        scene: SceneTensors,
        weight: Float[Tensor, "B A"],
        config: TrajectoryGuidance | None = None,
        num_steps: int = NUM_STEPS,
    ) -> "NearestCandidateGuide":
        """Make a guide for the agents of a scene; weight 0 means no guidance."""
        config = TrajectoryGuidance() if config is None else config
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
        """Move predicted clean latents towards candidates."""
        if level > self.config.first_level:
            return clean
        is_last = level <= self.last_level
        strength = self.config.last_step_share if is_last else 1.0
        if not strength:
            return clean
        way, exists, stays = self._nearest(clean)
        pull = torch.where(exists, strength * self.weight, 0.0)
        if self._is_any_agent_stationary:
            late = level <= self.config.first_level / 2
            share = torch.where(stays, 1.0, self.config.starting_share) * late
            pull = torch.where(self.is_standing, share * pull, pull)
        return torch.addcmul(clean, way, pull[..., None] / self.scale)

    def distances_m(self, clean: Float[Tensor, "S B A 10"]) -> Float[Tensor, "N"]:
        """Distances of guided agents to their nearest candidates."""
        way, exists, _ = self._nearest(clean)
        return way.norm(dim=-1)[exists & (self.weight > 0)]

    def _nearest(
        self, clean: Float[Tensor, "S B A 10"]
    ) -> tuple[Float[Tensor, "S B A 10"], Bool[Tensor, "S B A"], Tensor]:
        """Vectors to the nearest allowed candidates, who has one, and who stays."""
        predicted, stays = clean * self.scale, self.is_standing
        cost, exists = self._of_going
        if self._is_any_agent_stationary:
            distance = (predicted - self.still).norm(dim=-1)
            stays = stays & (distance < self.config.stays_m)
            cost = torch.where(stays[..., None], self._of_staying[0], cost)
            exists = torch.where(stays, self._of_staying[1], exists)
        # Squared distance without the term that is equal for all candidates.
        product = (self.candidates @ predicted[..., None])[..., 0]
        best = torch.sub(cost, product, alpha=2).argmin(dim=-1)
        index = best[..., None, None].expand(*best.shape, 1, predicted.shape[-1])
        table = self.candidates.expand(len(predicted), *self.candidates.shape)
        way = table.gather(-2, index)[..., 0, :] - predicted
        return way, exists.expand(best.shape), stays

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
        """Squared lengths of allowed candidates (others infinite); agents with any."""
        squares = self.candidates.square().sum(dim=-1)
        return squares.masked_fill(~some, torch.inf), some.any(dim=-1)
