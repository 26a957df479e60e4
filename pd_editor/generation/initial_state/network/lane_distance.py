"""Distances and vectors between agents and lanes."""

import math
from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pd_editor.analysis.metrics.lanes import OFF_LANE_M
from pd_editor.generation.features.map_pieces import (
    CROSSWALK_KIND,
    PIECE_LENGTH_M,
    PIECE_SHAPE,
)
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network.features import as_complex
from pd_editor.generation.inputs import SceneTensors

_IS_INTERSECTION: Final = PIECE_SHAPE.index("is_intersection")
_HALF_LANE_M: Final = 1.75


def is_on_road(scene: SceneTensors) -> Bool[Tensor, "B A"]:
    """Whether agents are within ``OFF_LANE_M`` of a centre line (the paper's rule)."""
    return offset_from_lane_m(scene.agent_pose[..., :2], scene)[1] <= OFF_LANE_M


def follows_lanes(scene: SceneTensors) -> Bool[Tensor, "B A"]:
    """Agents that follow lanes: all but pedestrians, if there are lanes."""
    has_lanes = (scene.has_piece & (scene.piece_kind != CROSSWALK_KIND)).any(dim=-1)
    return scene.has_agent & (scene.agent_kind != PEDESTRIAN) & has_lanes[:, None]


def offset_from_lane_m(
    position_m: Float[Tensor, "*s B A 2"], scene: SceneTensors
) -> tuple[Float[Tensor, "*s B A 2"], Float[Tensor, "*s B A"]]:
    """Vector from the nearest point of a centre line to each position, and its length.

    Pieces of lanes count as straight. The length is infinite without lanes.
    """
    offset, length = CenterLines.of(scene).offset_m(as_complex(position_m))
    return torch.view_as_real(offset), length


@dataclass(frozen=True, kw_only=True, eq=False)
class CenterLines:
    """Lane pieces of B scenes, as complex numbers."""

    middle_m: Complex[Tensor, "B 1 P"]
    axis: Complex[Tensor, "B 1 P"]
    """Directions, of length one."""
    half_m: Float[Tensor, "B 1 P"]
    far_m: Float[Tensor, "B 1 P"]
    """Added to distances: infinity for padding and crosswalks."""
    is_junction: Bool[Tensor, "B 1 P"]

    @classmethod
    def of(cls, scene: SceneTensors) -> "CenterLines":
        """All pieces but crosswalks."""
        heading = scene.piece_pose[:, None, :, 2]
        usable = scene.has_piece & (scene.piece_kind != CROSSWALK_KIND)
        nothing = torch.zeros_like(heading)
        return cls(
            middle_m=as_complex(scene.piece_pose[:, None, :, :2]),
            axis=torch.complex(heading.cos(), heading.sin()),
            half_m=scene.piece_shape[:, None, :, 0] * (PIECE_LENGTH_M / 2),
            far_m=nothing.masked_fill(~usable[:, None], math.inf),
            is_junction=scene.piece_shape[:, None, :, _IS_INTERSECTION] > 0.5,
        )

    def outside_junctions(self) -> "CenterLines":
        """Those of no junction."""
        return replace(self, far_m=self.far_m.masked_fill(self.is_junction, math.inf))

    def in_junction(self, place_m: Complex[Tensor, "*s B A"]) -> Bool[Tensor, "*s B A"]:
        """Whether the nearest lane is in a junction, and the place is on it."""
        gap, length_m = self._gaps_m(place_m)
        nearest_m, nearest = length_m.min(dim=-1, keepdim=True)
        is_junction = self.is_junction.expand(gap.shape).gather(-1, nearest)
        return (is_junction & (nearest_m <= _HALF_LANE_M))[..., 0]

    def direction(
        self, place_m: Complex[Tensor, "*s B A"]
    ) -> Complex[Tensor, "*s B A"]:
        """Direction of the nearest lane; 0 beside lanes and in junctions."""
        gap, length_m = self._gaps_m(place_m)
        nearest_m, nearest = length_m.min(dim=-1, keepdim=True)
        axis = torch.where(self.is_junction, 0, self.axis).expand(gap.shape)
        axis = axis.gather(-1, nearest)
        return torch.where(nearest_m <= _HALF_LANE_M, axis, 0)[..., 0]

    def offset_m(
        self, place_m: Complex[Tensor, "*s B A"]
    ) -> tuple[Complex[Tensor, "*s B A"], Float[Tensor, "*s B A"]]:
        """Vector from the nearest point of a centre line to each position; its length."""
        gap, far_m = self._gaps_m(place_m)
        length_m, nearest = far_m.min(dim=-1, keepdim=True)
        axis = self.axis.expand(gap.shape).gather(-1, nearest)
        return (gap.gather(-1, nearest) * axis)[..., 0], length_m[..., 0]

    def _gaps_m(
        self, place_m: Complex[Tensor, "*s B A"]
    ) -> tuple[Complex[Tensor, "*s B A P"], Float[Tensor, "*s B A P"]]:
        """From the nearest point of each piece, in its own frame; lengths."""
        own = (place_m[..., None] - self.middle_m) * self.axis.conj_physical()
        inside = torch.minimum(torch.maximum(own.real, -self.half_m), self.half_m)
        gap = own - inside
        return gap, gap.abs() + self.far_m
