"""Guidance of predicted clean states: boxes apart, moving agents on lanes."""

from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pd_editor.diffusion.core.config_limits import check_settings
from pd_editor.diffusion.core.noise_schedule import NoiseSchedule
from pd_editor.diffusion.initial_state.box_overlap import OverlapVectors
from pd_editor.diffusion.initial_state.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    Conditioning,
    sampling_conditioning,
)
from pd_editor.diffusion.initial_state.features import as_complex
from pd_editor.diffusion.initial_state.lane_distance import CenterLines, follows_lanes
from pd_editor.diffusion.initial_state.sampler import InitialStateGuide
from pd_editor.diffusion.initial_state.state_encoding import (
    NUM_MOTION_PARTS,
    POSITION_UNIT_M,
    is_standing,
    unit_vectors,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors

_SURELY: Final = 0.5
"""Codes are means of -0.5 and 0.5: by so much is one activity likelier than another."""


@dataclass(frozen=True, kw_only=True)
class InitialStateGuidance:
    """How strongly predicted clean states are changed, below some noise."""

    push: float = 1.0
    """Share of an overlap that each step takes away."""
    pull: float = 0.8
    """Share of the way to the lane that each step goes."""
    moving_offset_m: float = 2.0
    """Moving agents, and those that surely wait in traffic, are left alone within this
    distance of a centre line."""
    standing_offset_m: float = 10.0
    """The same of other standing ones: cars park beside lanes, in driveways, on lots."""
    on_road_offset_m: float = 3.5
    """The same of standing ones that are told to be on the road; who is told to be off
    the road is left alone anywhere."""
    within_lanes_offset_m: float = 1.4
    """The same of all where no agent may be off the road: most lanes are 3 to 3.5 m wide.
    Without it 22 % of the vehicles placed on three demos were beside the drivable
    surface, with it 1."""
    stopped_in_junctions: float = 0.2
    """Share of the standing vehicles that may be in a junction; the others are moved to
    the nearest lane outside."""
    clear_of_junctions_m: float = 3.0
    """So far beyond the border of the junction: half of a vehicle and a little."""
    farthest_out_m: float = 20.0
    """To a lane outside; a vehicle with a longer way stays."""
    first_noise_m: float = 12.0
    """Above this noise on positions nothing is changed."""
    num_pushes: int = 2
    num_last_pushes: int = 12
    """In the last step: an agent pushed out of one box may be pushed into another."""
    gap_m: float = 0.4
    """Between boxes."""
    sideways: float = 0.5
    """Share of a push across the heading: agents rather move along it than out of their
    lane."""

    def __post_init__(self) -> None:
        check_settings(self)

    def within_lanes(self) -> "InitialStateGuidance":
        """Guidance where no agent may be off the road."""
        offset = self.within_lanes_offset_m
        return replace(self, moving_offset_m=offset, on_road_offset_m=offset)

    def of(
        self,
        scene: SceneTensors,
        schedule: NoiseSchedule,
        task: Conditioning | None = None,
        may_stop: Bool[Tensor, "B A"] | None = None,
    ) -> InitialStateGuide:
        """A guide for the agents of a scene that are not given.

        ``may_stop`` are those that may stand in a junction; None means all.
        """
        task = sampling_conditioning(scene) if task is None else task
        given = task.is_given
        overlaps = OverlapVectors.of(scene, gap_m=self.gap_m)
        lines, pulled = CenterLines.of(scene), _Pulled.of(scene, task, self)
        leaves, outside = None, lines.outside_junctions()
        if may_stop is not None:
            leaves = follows_lanes(scene) & ~given & ~may_stop

        def guide(
            clean: Float[Tensor, "S B A P"], level: float
        ) -> Float[Tensor, "S B A P"]:
            noise = schedule.sigma(torch.tensor([level], device="cpu"))[0]
            if noise * POSITION_UNIT_M > self.first_noise_m:
                return clean
            start = as_complex(clean[..., :2] * POSITION_UNIT_M)
            place = start + self._pull(start, _may_park(clean), lines, pulled)
            if leaves is not None:
                stands = leaves & is_standing(clean)
                if bool(stands.any()):
                    stuck = stands & lines.in_junction(place)
                    place = place + stuck * self._out(place, outside, pulled)
            axis = as_complex(unit_vectors(clean[..., 2:4]))
            for _ in range(self.num_pushes if level > 0 else self.num_last_pushes):
                push = self._push(place, axis, overlaps, given)
                if not bool(push.any()):
                    break
                place = place + push
            moved = torch.view_as_real(place - start) / POSITION_UNIT_M
            return torch.cat([clean[..., :2] + moved, clean[..., 2:]], dim=-1)

        return guide

    def _push(
        self,
        place_m: Complex[Tensor, "S B A"],
        axis: Complex[Tensor, "S B A"],
        overlaps: OverlapVectors,
        is_given: Bool[Tensor, "B A"],
    ) -> Complex[Tensor, "S B A"]:
        """Metres out of all overlaps; who overlaps a given agent goes all the way."""
        share = torch.where(is_given, 1.0, 0.5)[:, None]
        shift = (overlaps(place_m, axis) * share).sum(dim=-1)
        own = shift * axis.conj_physical()
        push = self.push * torch.complex(own.real, self.sideways * own.imag) * axis
        return torch.where(is_given, 0.0, push)

    def _out(
        self,
        place_m: Complex[Tensor, "S B A"],
        outside: CenterLines,
        pulled: "_Pulled",
    ) -> Complex[Tensor, "S B A"]:
        """Metres onto the nearest lane outside of junctions, within the square."""
        offset, length_m = outside.offset_m(place_m)
        share = 1 + self.clear_of_junctions_m / length_m.clamp(1.0, 1e6)
        way = -torch.where(length_m <= self.farthest_out_m, share * offset, 0.0)
        end = torch.view_as_real(place_m + way).abs()
        return way * (end.amax(dim=-1) <= pulled.half_side_m)

    def _pull(
        self,
        place_m: Complex[Tensor, "S B A"],
        may_park: Bool[Tensor, "S B A"],
        lines: CenterLines,
        pulled: "_Pulled",
    ) -> Complex[Tensor, "S B A"]:
        """Metres towards the nearest lane for those too far from it.

        Nobody is pulled out of the square: a lane beyond its border is not meant.
        """
        offset, length_m = lines.offset_m(place_m)
        allowed = torch.where(may_park, pulled.standing_offset_m, self.moving_offset_m)
        too_far = (length_m - allowed).clamp_(0, 1e3) * pulled.share
        way = -offset * (too_far / length_m.clamp(1e-6, 1e6))
        end = torch.view_as_real(place_m + way).abs()
        return way * (end.amax(dim=-1) <= pulled.half_side_m)


def _may_park(clean: Float[Tensor, "S B A P"]) -> Bool[Tensor, "S B A"]:
    """Standing agents, but for those that are predicted to wait rather than to park."""
    stands = is_standing(clean)
    if clean.shape[-1] == NUM_MOTION_PARTS:
        return stands
    parked, waiting, _ = clean[..., NUM_MOTION_PARTS:].unbind(-1)
    return stands & (waiting - parked < _SURELY)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pulled:
    """Who is pulled to lanes, and how much."""

    standing_offset_m: Float[Tensor, "B A"]
    share: Float[Tensor, "B A"]
    half_side_m: Float[Tensor, "B 1"]
    """Of the square around the middle, out of which nobody is pulled."""

    @classmethod
    def of(
        cls, scene: SceneTensors, task: Conditioning, guidance: InitialStateGuidance
    ) -> "_Pulled":
        """Those that follow lanes, are drawn, and not told to be off the road."""
        is_pulled = (
            follows_lanes(scene) & (task.on_road != CONDITIONED_NO) & ~task.is_given
        )
        return cls(
            standing_offset_m=torch.where(
                task.on_road == CONDITIONED_YES,
                guidance.on_road_offset_m,
                guidance.standing_offset_m,
            ),
            share=guidance.pull * is_pulled,
            half_side_m=task.half_side_m[:, None],
        )
