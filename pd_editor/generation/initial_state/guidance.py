"""Guidance of predicted clean states: separates boxes, pulls agents to lanes."""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pd_editor.analysis.metrics.lanes import BEYOND_ROADS_M
from pd_editor.generation.core.noise_schedule import NoiseSchedule, relative_noise
from pd_editor.generation.defaults import check_settings
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.features import as_complex
from pd_editor.generation.initial_state.network.lane_distance import (
    CenterLines,
    follows_lanes,
)
from pd_editor.generation.initial_state.network.state_encoding import (
    NUM_MOTION_PARTS,
    POSITION_UNIT_M,
    is_standing,
    unit_vectors,
)
from pd_editor.generation.initial_state.sampler import InitialStateGuide
from pd_editor.generation.initial_state.state_overlap import OverlapVectors
from pd_editor.generation.inputs import SceneTensors


@dataclass(frozen=True, kw_only=True)
class InitialStateGuidance:
    """Strengths and thresholds of the guidance of predicted clean states."""

    pull: float = 0.8
    """Share of the distance to the lane that each step moves an agent."""
    moving_offset_m: float = 2.0
    """Moving agents, and those clearly waiting in traffic, are not pulled within this
    distance of a centre line."""
    standing_offset_m: float = 10.0
    """The same for other stationary agents: cars park beside lanes, in driveways, on lots."""
    on_road_offset_m: float = 3.5
    """The same for stationary agents that are conditioned on-road. Agents conditioned
    off-road are not pulled to lanes."""
    within_lanes_offset_m: float = 1.4
    """The same for all agents where all are conditioned on-road: most lanes are 3 to 3.5 m
    wide."""
    stopped_in_junctions: float = 0.2
    """Share of the standing vehicles that may be in a junction; the others are moved to
    the nearest lane outside, if there is one near."""
    clear_of_junctions_m: float = 3.0
    """So far beyond the border of the junction: half of a vehicle and a little."""
    most_askew_deg: float = 10.0
    """Agents that stand on a lane outside junctions, turned further from its direction,
    are aligned with it in the last step."""
    first_noise_m: float = 12.0
    """There is no guidance above this noise on positions."""
    num_pushes: int = 2
    """Number of pushes out of other boxes in each step, and six times as many in the last
    one: a push out of one box may lead into another."""
    gap_m: float = 0.4
    """Gap between boxes."""
    sideways: float = 0.5
    """Factor of the component of a push across the heading, so that agents stay in their
    lanes."""

    def __post_init__(self) -> None:
        check_settings(self)

    def within_lanes(self) -> "InitialStateGuidance":
        """Guidance where all agents are conditioned on-road."""
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
        # Nothing moves the first agents, if all scenes give them.
        first = int(given.all(dim=0).cumprod(dim=0).sum())
        overlaps = OverlapVectors.of(scene, gap_m=self.gap_m, first=first)
        lines = CenterLines.of(scene)
        pulled = _Pulled.of(scene, task, self).since(first)
        leaves, outside = None, lines.outside_junctions()
        is_aligned = pulled.share > 0
        if may_stop is not None:
            leaves = (follows_lanes(scene) & ~given & ~may_stop)[:, first:]

        def guide(
            clean: Float[Tensor, "S B A P"], level: float
        ) -> Float[Tensor, "S B A P"]:
            noise = relative_noise(schedule, torch.tensor([level], device="cpu"))[0]
            if noise * POSITION_UNIT_M > self.first_noise_m:
                return clean
            kept, clean = clean.tensor_split([first], dim=-2)
            others = _poses(kept)
            start, own_axis = _poses(clean)
            place = start + self._pull(start, _may_park(clean), lines, pulled)
            if leaves is not None:
                stands = leaves & is_standing(clean)
                if bool(stands.any()):
                    stuck = stands & lines.in_junction(place)
                    place = place + stuck * self._out(place, outside, pulled)
            axis = own_axis
            if level == 0:
                aligned = lines.direction(place)
                aligned = torch.where(is_aligned & is_standing(clean), aligned, 0)
                axis = self._aligned(axis, aligned)
            for _ in range(self.num_pushes * (1 if level > 0 else 6)):
                pairs = zip(others, (place, axis), strict=True)
                everyone = (torch.cat(pair, dim=-1) for pair in pairs)
                push = self._push(*everyone, overlaps, given)
                if not bool(push.any()):
                    break
                place = place + push
            moved = torch.view_as_real(place - start) / POSITION_UNIT_M
            is_turned = (axis != own_axis)[..., None]
            heading = torch.where(is_turned, torch.view_as_real(axis), clean[..., 2:4])
            guided = [clean[..., :2] + moved, heading, clean[..., 4:]]
            return torch.cat([kept, torch.cat(guided, dim=-1)], dim=-2)

        return guide

    def _aligned(
        self, axis: Complex[Tensor, "S B A"], lane_axis: Complex[Tensor, "S B A"]
    ) -> Complex[Tensor, "S B A"]:
        """Axes that are too far from a lane's, turned to it or its opposite.

        ``lane_axis`` is 0 for agents that are not turned.
        """
        own = axis * lane_axis.conj_physical()
        is_askew = own.imag.abs() > math.sin(math.radians(self.most_askew_deg))
        return torch.where(
            is_askew, torch.where(own.real < 0, -lane_axis, lane_axis), axis
        )

    def _push(
        self,
        place_m: Complex[Tensor, "S B A"],
        axis: Complex[Tensor, "S B A"],
        overlaps: OverlapVectors,
        is_given: Bool[Tensor, "B A"],
    ) -> Complex[Tensor, "S B N"]:
        """Displacement in metres out of all overlaps; full for overlaps with given agents."""
        share = torch.where(is_given, 1.0, 0.5)[:, None]
        shift = (overlaps(place_m, axis) * share).sum(dim=-1)
        axis, is_given = axis[..., overlaps.first :], is_given[:, overlaps.first :]
        own = shift * axis.conj_physical()
        push = torch.complex(own.real, self.sideways * own.imag) * axis
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
        way = -torch.where(length_m <= BEYOND_ROADS_M, share * offset, 0.0)
        end = torch.view_as_real(place_m + way).abs()
        return way * (end.amax(dim=-1) <= pulled.half_side_m)

    def _pull(
        self,
        place_m: Complex[Tensor, "S B A"],
        may_park: Bool[Tensor, "S B A"],
        lines: CenterLines,
        pulled: "_Pulled",
    ) -> Complex[Tensor, "S B A"]:
        """Displacement in metres towards the nearest lane for agents too far from it.

        No agent is pulled out of the square.
        """
        offset, length_m = lines.offset_m(place_m)
        allowed = torch.where(may_park, pulled.standing_offset_m, self.moving_offset_m)
        too_far = (length_m - allowed).clamp_(0, 1e3) * pulled.share
        way = -offset * (too_far / length_m.clamp(1e-6, 1e6))
        end = torch.view_as_real(place_m + way).abs()
        return way * (end.amax(dim=-1) <= pulled.half_side_m)


def _poses(
    clean: Float[Tensor, "S B A P"],
) -> tuple[Complex[Tensor, "S B A"], Complex[Tensor, "S B A"]]:
    """Places in metres, and axes of length one."""
    place, axis = clean[..., :2] * POSITION_UNIT_M, unit_vectors(clean[..., 2:4])
    return as_complex(place), as_complex(axis)


def _may_park(clean: Float[Tensor, "S B A P"]) -> Bool[Tensor, "S B A"]:
    """Stationary agents, except those that are predicted to wait rather than to park."""
    stands = is_standing(clean)
    if clean.shape[-1] == NUM_MOTION_PARTS:
        return stands
    parked, waiting, _ = clean[..., NUM_MOTION_PARTS:].unbind(-1)
    # Least difference of activity codes (means of -0.5 and 0.5) for a clear prediction.
    return stands & (waiting - parked < 0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pulled:
    """Agents that are pulled to lanes, with their thresholds."""

    standing_offset_m: Float[Tensor, "B A"]
    share: Float[Tensor, "B A"]
    half_side_m: Float[Tensor, "B 1"]
    """Half side of the square around the centre, which agents are not pulled out of."""

    @classmethod
    def of(
        cls, scene: SceneTensors, task: Conditioning, guidance: InitialStateGuidance
    ) -> "_Pulled":
        """Sampled agents that follow lanes and are not conditioned off-road."""
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

    def since(self, first: int) -> "_Pulled":
        """Without the first agents."""
        offset_m, share = self.standing_offset_m[:, first:], self.share[:, first:]
        return replace(self, standing_offset_m=offset_m, share=share)
