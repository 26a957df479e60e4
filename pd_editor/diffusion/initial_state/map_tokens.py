"""The map tokens near noisy poses, looked up at each step."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pd_editor.diffusion.core.attention import Mask
from pd_editor.diffusion.initial_state.features import (
    NoiseFactors,
    NoisyPoses,
    as_complex,
    crossing_factors,
    piece_relations,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.windows.lane_pieces import CROSSWALK_KIND
from pd_editor.windows.scene_features import PEDESTRIAN


@dataclass(frozen=True, kw_only=True, eq=False)
class NearTokens:
    """The M map tokens nearest to each of A agents in S versions of B scenes."""

    relations: Float[Tensor, "B S A M F"]
    encoded: Float[Tensor, "B S A M C"]
    """What ``MapTokens.encoded`` holds of each."""
    axis: Complex[Tensor, "B S A M"]
    """Direction of each, in the frame of the scene."""
    mask: Mask
    """Of shape [B S A 1 M]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapTokens:
    """The map tokens of B scenes."""

    middle_m: Float[Tensor, "B P 2"]
    pose: Complex[Tensor, "BP 2"]
    """Middle and direction, of all scenes in a row."""
    encoded: Float[Tensor, "BP C"]
    """What does not depend on poses; of all scenes in a row."""
    exists: Bool[Tensor, "B P"] | None
    """None where no token is missing."""
    factors: Float[Tensor, "B 1 A P"] | None
    """By how much further each token seems to each agent; None where all are 1."""

    @classmethod
    def of(cls, scene: SceneTensors, encoded: Float[Tensor, "B P C"]) -> "MapTokens":
        """All tokens of some scenes."""
        middle_m, heading = scene.piece_pose[..., :2], scene.piece_pose[..., 2]
        is_crossing = scene.piece_kind == CROSSWALK_KIND
        factors = None
        if bool(is_crossing.any()):
            is_walking = scene.agent_kind == PEDESTRIAN
            factors = crossing_factors(is_walking, is_crossing)[:, None]
        axis = torch.complex(heading.cos(), heading.sin())
        pose = torch.stack([as_complex(middle_m), axis], dim=-1)
        return cls(
            middle_m=middle_m.contiguous(),
            pose=pose.flatten(0, 1),
            encoded=encoded.flatten(0, 1),
            exists=None if bool(scene.has_piece.all()) else scene.has_piece,
            factors=factors,
        )

    def near(
        self, poses: NoisyPoses, noise: NoiseFactors, num_nearest: int
    ) -> NearTokens:
        """The tokens nearest to each pose, in any order."""
        num_scenes, num_tokens = self.middle_m.shape[:2]
        shape = poses.position_m.shape
        points = torch.view_as_real(poses.position_m).flatten(1, 2)
        distance = torch.cdist(points, self.middle_m).view(*shape, num_tokens)
        if self.factors is not None:
            distance = distance * self.factors
        if self.exists is not None:
            distance = distance.masked_fill(~self.exists[:, None, None], math.inf)
        number = min(num_nearest, num_tokens)
        index = distance.topk(number, dim=-1, largest=False, sorted=False).indices
        if num_scenes > 1:
            first = torch.arange(num_scenes, device=index.device) * num_tokens
            index = index + first[:, None, None, None]
        row = index.flatten()
        found = self.pose.index_select(0, row).view(*index.shape, 2)
        middle_m, axis = found.unbind(-1)
        mask = Mask(None, None)
        if self.exists is not None:
            mask = Mask.of(self.exists.flatten()[index][..., None, :])
        return NearTokens(
            relations=piece_relations(poses, middle_m, axis, noise),
            encoded=self.encoded.index_select(0, row).view(*index.shape, -1),
            axis=axis,
            mask=mask,
        )
