"""Search of the map tokens near noisy poses at each step."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Complex, Float, Int
from torch import Tensor

from pd_editor.generation.core.attention import Mask, grouped
from pd_editor.generation.core.devices import is_known
from pd_editor.generation.features.lane_tokens import CROSSWALK_KIND
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network.features import (
    NoiseFactors,
    NoisyPoses,
    as_complex,
    crossing_factors,
    piece_relations,
)
from pd_editor.generation.inputs.relative_pose import selected
from pd_editor.generation.inputs.scene_batch import SceneTensors


class TokenGroup(NamedTuple):
    """Map tokens of one type in B scenes."""

    middle_m: Float[Tensor, "B P 2"]
    axis: Complex[Tensor, "B P"]
    """Directions, of length one."""
    encoded: Float[Tensor, "B P C"]
    """Embeddings, which do not depend on poses."""
    exists: Bool[Tensor, "B P"] | None
    """Mask of tokens; None if there is no padding."""
    least: int
    """Least number of tokens of a scene."""
    is_crossing: Bool[Tensor, "B P"] | None = None
    """Crosswalks; None if there are none."""
    factors: Float[Tensor, "_ 1 A P"] | None = None
    """Factors of squared distances between agents and tokens; None if all are 1."""

    @classmethod
    def of_lanes(
        cls, scene: SceneTensors, encoded: Float[Tensor, "B P C"]
    ) -> "TokenGroup":
        """Tokens of lanes and crosswalks."""
        is_crossing = scene.piece_kind == CROSSWALK_KIND
        group = cls._of(scene.piece_pose, scene.has_piece, encoded)
        return group._replace(
            is_crossing=None if is_known(~is_crossing.any()) else is_crossing
        )

    @classmethod
    def of_boundary(
        cls, scene: SceneTensors, encoded: Float[Tensor, "B E C"]
    ) -> "TokenGroup":
        """Tokens of the drivable area's boundary."""
        return cls._of(scene.boundary_pose, scene.has_boundary, encoded)

    @classmethod
    def _of(
        cls,
        pose: Float[Tensor, "B P 3"],
        exists: Bool[Tensor, "B P"],
        encoded: Float[Tensor, "B P C"],
    ) -> "TokenGroup":
        return cls(
            middle_m=pose[..., :2].contiguous(),
            axis=torch.complex(pose[..., 2].cos(), pose[..., 2].sin()),
            encoded=encoded,
            exists=None if is_known(exists.all()) else exists,
            least=int(exists.sum(dim=-1).min()) if exists.is_cpu else 0,
        )

    def seen_by(self, agent_kind: Int[Tensor, "B A"]) -> "TokenGroup":
        """The tokens with the distances of agents of some kinds."""
        if self.is_crossing is None:
            return self
        is_walking = agent_kind == PEDESTRIAN
        factors = crossing_factors(is_walking, self.is_crossing)[:, None]
        return self._replace(factors=factors.square())

    def nearest(
        self, poses: NoisyPoses, number: int
    ) -> tuple[Int[Tensor, "B S A M"], Mask]:
        """Indices of the tokens nearest to each pose, in any order."""
        own_x, own_y = torch.view_as_real(poses.position_m)[..., None, :].unbind(-1)
        x, y = self.middle_m[:, None, None].unbind(-1)
        x, y = own_x - x, own_y - y
        square = torch.addcmul(x * x, y, y)
        if self.factors is not None:
            square = square * self.factors
        if self.exists is not None:
            square = square.masked_fill(~self.exists[:, None, None], math.inf)
        number = min(number, self.middle_m.shape[1])
        index = square.topk(number, dim=-1, largest=False, sorted=False).indices
        if self.exists is None or number <= self.least:
            return index, Mask(None, None)
        scene = torch.arange(len(self.exists), device=index.device)
        is_token = self.exists[scene[:, None, None, None], index]
        return index, Mask.of(is_token[..., None, :])


class NearTokens(NamedTuple):
    """The M map tokens nearest to each of A agents in S versions of B scenes.

    Tokens of the first group come first.
    """

    relations: Float[Tensor, "B S A M F"]
    encoded: Float[Tensor, "B S A M C"]
    """Rows of ``TokenGroup.encoded``."""
    axis: Complex[Tensor, "B S A M"]
    """Direction of each, in the frame of the scene."""
    numbers: tuple[int, ...]
    mask: Mask
    """Of shape [B S A G M]: row g sees the tokens of group g."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapTokens:
    """The map tokens of B scenes, in groups."""

    groups: tuple[TokenGroup, ...]
    pose: Complex[Tensor, "T 2"]
    """Midpoint and direction, of all groups and scenes, concatenated."""
    encoded: Float[Tensor, "T C"]

    @classmethod
    def of(cls, *groups: TokenGroup) -> "MapTokens":
        """Concatenate groups of tokens."""
        pose = [
            torch.stack([as_complex(one.middle_m), one.axis], dim=-1).flatten(0, 1)
            for one in groups
        ]
        encoded = [one.encoded.flatten(0, 1) for one in groups]
        return cls(groups=groups, pose=torch.cat(pose), encoded=torch.cat(encoded))

    def seen_by(self, agent_kind: Int[Tensor, "B A"]) -> "MapTokens":
        """The tokens with the distances of agents of some kinds."""
        groups = tuple(one.seen_by(agent_kind) for one in self.groups)
        return replace(self, groups=groups)

    def near(
        self,
        poses: NoisyPoses,
        noise: NoiseFactors,
        *num_nearest: int,
        folds_turns: bool = False,
    ) -> NearTokens:
        """The tokens of each group that are nearest to each pose, in any order."""
        rows: list[Tensor] = []
        masks: list[Mask] = []
        first = 0
        for group, number in zip(self.groups, num_nearest, strict=True):
            index, mask = group.nearest(poses, number)
            num_scenes, num_tokens = group.axis.shape
            if num_scenes > 1:
                scene = torch.arange(num_scenes, device=index.device) * num_tokens
                index = index + scene[:, None, None, None]
            rows.append(index + first if first else index)
            masks.append(mask)
            first += group.axis.numel()
        row = rows[0] if len(rows) == 1 else torch.cat(rows, dim=-1)
        middle_m, axis = selected(self.pose, row).unbind(-1)
        numbers = tuple(one.shape[-1] for one in rows)
        return NearTokens(
            relations=piece_relations(
                poses, middle_m, axis, noise, folds_turns=folds_turns
            ),
            encoded=selected(self.encoded, row),
            axis=axis,
            numbers=numbers,
            mask=grouped(masks, numbers, self.encoded),
        )
