"""Differentiable overlap depth of boxes, each approximated by three discs."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pd_editor.generation.core.devices import constant
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network.state_encoding import (
    POSITION_UNIT_M,
    unit_vectors,
)
from pd_editor.generation.inputs import SceneTensors

_PLACES: Final = (-1.0, 0.0, 1.0)
_NUDGE_M: Final = 1e-3


def overlap_depth_m(
    states: Float[Tensor, "*b A P"], scene: SceneTensors
) -> Float[Tensor, "*b A A"]:
    """Depth in metres by which each pair of boxes overlaps, 0 where it does not.

    A box is approximated by three discs of its width along its length. Pairs of
    pedestrians do not count, since they walk in groups.
    """
    # The square root has no gradient at 0.
    distance = (_offsets_m(states, scene).square().sum(dim=-1) + 1e-6).sqrt()
    depth = _radii_m(scene) - distance.amin(dim=-1)
    return depth.clamp_min(0) * _counts(scene)


@dataclass(frozen=True, kw_only=True, eq=False)
class OverlapVectors:
    """Displacements of N of A agents in B scenes that resolve overlaps of their boxes.

    Corners exceed the discs: a gap of 0.4 m separates those of cars.
    """

    reach_m: Float[Tensor, "B A 3"]
    """Position of each disc along the heading, relative to the centre."""
    least_m: Float[Tensor, "B N A"]
    """Least distance between discs; below 0 for pairs that may overlap."""
    far_m: Float[Tensor, "B N A"]
    """Distance of centres from which on boxes do not overlap."""
    nudge_m: Float[Tensor, "N A"]
    """Displacement of agents at the same position: the first one moves ahead."""
    first: int = 0
    """The N agents are those from this one on."""

    @classmethod
    def of(
        cls, scene: SceneTensors, *, gap_m: float = 0.0, first: int = 0
    ) -> "OverlapVectors":
        """Geometry of the agents of a scene, with a gap between them."""
        places = constant(_PLACES, scene.agent_size)
        radii = _radii_m(scene)
        nudge = torch.ones_like(radii[0]).triu() * 2 - 1
        reach, counts = _reach_m(scene), _counts(scene)
        far_m = radii + gap_m + reach[..., None] + reach[..., None, :]
        return cls(
            reach_m=reach[..., None] * places,
            least_m=torch.where(counts, radii + gap_m, -1.0)[:, first:],
            far_m=torch.where(counts, far_m + 2 * _NUDGE_M, -1.0)[:, first:],
            nudge_m=_NUDGE_M * nudge[first:],
            first=first,
        )

    def __call__(
        self, place_m: Complex[Tensor, "*b A"], axis: Complex[Tensor, "*b A"]
    ) -> Complex[Tensor, "*b N A"]:
        """Displacement of the first agent of each pair; 0 if they do not overlap.

        Positions and axes (headings of length one) are complex numbers.
        """
        between = place_m[..., self.first :, None] - place_m[..., None, :]
        found = torch.zeros_like(between)
        near = (between.abs() < self.far_m).nonzero(as_tuple=True)
        *scene, one, other = near
        if not len(one):
            return found
        discs = place_m[..., None] + axis[..., None] * self.reach_m
        offset = discs[*scene, one + self.first, :, None] - discs[*scene, other, None]
        offset = offset.flatten(-2)
        nearest = offset.abs().argmin(dim=-1, keepdim=True)
        ahead = self.nudge_m[one, other] * axis[*scene, one + self.first]
        offset = offset.gather(-1, nearest)[..., 0] + ahead
        distance = offset.abs()
        least_m = self.least_m.expand(between.shape)[near]
        depth = (least_m - distance).clamp_min_(0)
        found[near] = offset * (depth / distance.clamp_min_(1e-6))
        return found


def _offsets_m(
    states: Float[Tensor, "*b A P"], scene: SceneTensors
) -> Float[Tensor, "*b A A 9 2"]:
    """Vectors from each disc of the second agent of a pair to each of the first."""
    position_m = states[..., :2] * POSITION_UNIT_M
    axis = unit_vectors(states[..., 2:4])
    reach = _reach_m(scene)[..., None, None]
    places = constant(_PLACES, states)[:, None]
    discs = position_m[..., None, :] + axis[..., None, :] * places * reach
    offset = discs[..., :, None, :, None, :] - discs[..., None, :, None, :, :]
    return offset.flatten(-3, -2)


def _reach_m(scene: SceneTensors) -> Float[Tensor, "B A"]:
    """Distance between the centre of each agent and its outer discs."""
    length, width = scene.agent_size.unbind(-1)
    return ((length - width) / 2).clamp_min(0)


def _radii_m(scene: SceneTensors) -> Float[Tensor, "B A A"]:
    radius = scene.agent_size.amin(dim=-1) / 2
    return radius[..., None] + radius[..., None, :]


def _counts(scene: SceneTensors) -> Bool[Tensor, "B A A"]:
    walks = scene.agent_kind == PEDESTRIAN
    counts = ~(walks[..., None] & walks[..., None, :])
    counts &= scene.has_agent[..., None] & scene.has_agent[..., None, :]
    eye = torch.eye(counts.shape[-1], dtype=torch.bool, device=counts.device)
    return counts & ~eye
