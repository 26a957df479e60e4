"""Wishes about believed clean futures: near a Frenet candidate of the agent.

At each step of the later part of sampling, each agent's belief goes a part of the way
to the candidate that is nearest to it (Path Diffuser, section III-F, which leaves cost
and strength open). No gradient is needed: distances are those of latents in metres.
"""

from dataclasses import dataclass, field
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.scene_tensors import SceneTensors
from pd_editor.diffusion.trajectory_denoiser import TrajectoryDenoiser
from pd_editor.diffusion.trajectory_features import STANDING_MPS

_FROM_SHARE: Final = 0.3
"""Guidance begins when this share of the steps is done."""
_STANDING_FROM_SHARE: Final = 0.65
"""The same of those who stand: few of them start, and pulled early on none would."""
_STAYS_M: Final = 0.4
"""A future as close to standing still as this counts as standing."""


@dataclass(kw_only=True, eq=False)
class NearestCandidateGuide:
    """Pulls the agents of B scenes to their nearest candidates.

    Who stands and is believed to go on standing is pulled to standing candidates
    only, who is believed to start only to others; both late. Agents without candidates
    are left alone.
    """

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
    cost_before_m: float = field(default=0.0, init=False)
    """Mean distance of guided agents to their candidates before the last pull."""
    cost_after_m: float = field(default=0.0, init=False)

    @classmethod
    def of(
        cls,
        model: TrajectoryDenoiser,
        scene: SceneTensors,
        weight: Float[Tensor, "B A"],
    ) -> "NearestCandidateGuide":
        """A guide for the agents of a scene; the weight is 0 of those left alone."""
        decoder = model.way_points
        scale = decoder.get_buffer("scale_m") / decoder.num_steps**0.5
        candidates = scene.candidates * scale
        still = decoder.still(scene.agent_speed) * scale
        stays = (candidates - still[:, :, None]).norm(dim=-1) < _STAYS_M
        return cls(
            weight=weight,
            candidates=candidates,
            allowed=scene.has_candidate,
            is_standing=scene.agent_speed < STANDING_MPS,
            stays=stays & scene.has_candidate,
            still=still,
            scale=scale,
        )

    def __call__(
        self, clean: Float[Tensor, "S B A 10"], share_done: float
    ) -> Float[Tensor, "S B A 10"]:
        """Believed clean latents, nearer to candidates."""
        if share_done < _FROM_SHARE:
            return clean
        belief = clean * self.scale
        nearest, distance, exists = self._nearest(belief)
        pull = torch.where(exists, self.weight, 0.0)
        if share_done < _STANDING_FROM_SHARE:
            pull = torch.where(self.is_standing, 0.0, pull)
        guided = pull > 0
        count = guided.sum().clamp_min(1)
        self.cost_before_m = float((distance * guided).sum() / count)
        self.cost_after_m = float((distance * (1 - pull) * guided).sum() / count)
        return clean + pull[..., None] * (nearest - belief) / self.scale

    def _nearest(
        self, belief: Float[Tensor, "S B A 10"]
    ) -> tuple[
        Float[Tensor, "S B A 10"],
        Float[Tensor, "S B A"],
        Bool[Tensor, "S B A"],
    ]:
        """Nearest allowed candidates, distances to them, and whether there is one."""
        stays = self.is_standing & ((belief - self.still).norm(dim=-1) < _STAYS_M)
        starts = self.allowed & ~(self.is_standing[..., None] & self.stays)
        allowed = torch.where(stays[..., None], self.stays, starts)
        gap = (belief[..., None, :] - self.candidates).square().sum(-1)
        best = gap.masked_fill(~allowed, torch.inf).min(dim=-1)
        index = best.indices[..., None, None].expand(*best.indices.shape, 1, 10)
        table = self.candidates.expand(len(belief), *self.candidates.shape)
        nearest = table.gather(-2, index)[..., 0, :]
        exists = allowed.any(-1)
        distance = torch.where(exists, best.values, 0.0).sqrt()
        return nearest, distance, exists
