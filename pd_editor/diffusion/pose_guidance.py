"""Wishes about believed clean states: boxes apart, movers on lanes."""

import math
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.pose_encoding import (
    POSITION_UNIT_M,
    decode_states,
    unit_vectors,
)
from pd_editor.diffusion.pose_features import turned, turned_back
from pd_editor.diffusion.pose_noise import noise_scale
from pd_editor.diffusion.pose_sampling import PoseGuide
from pd_editor.diffusion.pose_spacing import overlap_vectors_m
from pd_editor.diffusion.scene_tensors import SceneTensors
from pd_editor.windows.scene_features import AGENT_KINDS, NUM_PIECE_KINDS

_PEDESTRIAN: Final = len(AGENT_KINDS) - 1
_CROSSWALK: Final = NUM_PIECE_KINDS - 1
_LENGTH_UNIT_M: Final = 10.0
"""Of the first number of ``PIECE_SHAPE``."""
_NUM_PUSHES: Final = 2
_NUM_LAST_PUSHES: Final = 12
"""Who is pushed out of one box may be pushed into another."""
_GAP_M: Final = 0.4
_SIDEWAYS: Final = 0.5
"""Agents rather move along their heading than out of their lane."""


@dataclass(frozen=True, kw_only=True)
class PoseGuidance:
    """How strongly believed clean states are changed, below some noise."""

    push: float = 1.0
    """Share of an overlap that each step takes away."""
    pull: float = 0.8
    """Share of the way to the lane that each step goes."""
    moving_offset_m: float = 2.0
    """Moving agents within this distance of a centre line are left alone."""
    standing_offset_m: float = 10.0
    """The same of standing ones: cars park beside lanes, in driveways and on lots."""
    first_noise_m: float = 12.0

    def of(
        self, scene: SceneTensors, is_given: Bool[Tensor, "B A"] | None = None
    ) -> PoseGuide:
        """A guide for the agents of a scene that are not given."""
        given = torch.zeros_like(scene.has_agent) if is_given is None else is_given

        def guide(
            clean: Float[Tensor, "S B A 5"], level: float
        ) -> Float[Tensor, "S B A 5"]:
            levels = torch.tensor(level, device="cpu")
            noise = noise_scale(levels)[0] * POSITION_UNIT_M
            if noise > self.first_noise_m:
                return clean
            shift = self._pull(clean, scene) * self.pull
            pulled = _shifted(clean, torch.where(given[..., None], 0.0, shift))
            apart = pulled
            for _ in range(_NUM_PUSHES if level > 0 else _NUM_LAST_PUSHES):
                shift = self._push(apart, scene, given) * self.push
                apart = _shifted(apart, torch.where(given[..., None], 0.0, shift))
            return apart

        return guide

    def _push(
        self,
        clean: Float[Tensor, "S B A 5"],
        scene: SceneTensors,
        is_given: Bool[Tensor, "B A"],
    ) -> Float[Tensor, "S B A 2"]:
        """Metres out of all overlaps; who overlaps a given agent goes all the way."""
        vectors = overlap_vectors_m(clean, scene, gap_m=_GAP_M)
        share = torch.where(is_given[:, None, :, None], 1.0, 0.5)
        shift = (vectors * share).sum(dim=-2)
        axis = unit_vectors(clean[..., 2:4])
        own = turned_back(shift, axis)
        return turned(own * own.new_tensor([1.0, _SIDEWAYS]), axis)

    def _pull(
        self, clean: Float[Tensor, "S B A 5"], scene: SceneTensors
    ) -> Float[Tensor, "S B A 2"]:
        """Metres towards the nearest lane for those too far from it."""
        states = decode_states(clean)
        heading = scene.piece_pose[..., 2]
        axis = torch.stack([heading.cos(), heading.sin()], dim=-1)[:, None]
        offset = states[..., None, :2] - scene.piece_pose[:, None, :, :2]
        along, aside = turned_back(offset, axis.expand_as(offset)).unbind(-1)
        half_m = scene.piece_shape[:, None, :, 0] * (_LENGTH_UNIT_M / 2)
        beyond = along - torch.minimum(torch.maximum(along, -half_m), half_m)
        gap = torch.stack([beyond, aside], dim=-1)
        usable = scene.has_piece & (scene.piece_kind != _CROSSWALK)
        distance = gap.norm(dim=-1).masked_fill(~usable[:, None], math.inf)
        nearest_m, nearest = distance.min(dim=-1)
        back = turned(gap, axis.expand_as(gap))
        index = nearest[..., None, None].expand(*nearest.shape, 1, 2)
        back = back.gather(-2, index)[..., 0, :]
        allowed = torch.where(
            states[..., 4] > 0, self.moving_offset_m, self.standing_offset_m
        )
        follows = (scene.agent_kind != _PEDESTRIAN) & usable.any(dim=-1, keepdim=True)
        too_far = (nearest_m - allowed).clamp(0, 1e3) * follows
        return -back * (too_far / nearest_m.clamp(1e-6, 1e6))[..., None]


def _shifted(
    clean: Float[Tensor, "S B A 5"], shift_m: Float[Tensor, "S B A 2"]
) -> Float[Tensor, "S B A 5"]:
    return torch.cat(
        [clean[..., :2] + shift_m / POSITION_UNIT_M, clean[..., 2:]], dim=-1
    )
