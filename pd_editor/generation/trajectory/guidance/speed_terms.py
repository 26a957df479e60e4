"""Terms on the speed of agents along their own predicted paths."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.analysis.guidance.guidance_kind import (
    LIMIT_BRAKING_MPS2,
    MAX_BRAKING_MPS2,
)
from pd_editor.analysis.guidance.kinds.course import LINE_MARGIN_M
from pd_editor.analysis.guidance.kinds.speed import (
    ComfortLimits,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.analysis.repair.state_repairs import STANDING_GAP_M
from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.generation.trajectory.guidance.target_motion import (
    Curves,
    TargetMotion,
    distances,
    extended,
    predicted_curves,
    speeds,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    AgentsTerm,
    ResidualRows,
    TermMakers,
    row_weights,
    together,
)
from pd_editor.generation.trajectory.network.decoding import STAYS_M
from pd_editor.scene.paths.car_following import ACCELERATION_MPS2, HARDEST_BRAKING_MPS2
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2

_NUM_RATES: Final = 4
"""Number of braking rates that are tried for a stop."""
_BESIDE_LINE_M: Final = LINE_MARGIN_M + 0.5
"""A stop line is stopped at this far beside its ends: a bit further than it counts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pace:
    """Predicted paths and pace of the guided agents of a term."""

    curves: Curves
    along_m: Float[Tensor, "S G T"]
    speed_mps: Float[Tensor, "S G T"]
    step_s: float

    @classmethod
    def of(cls, motion: PredictedMotion, agents: Int[Tensor, "G"]) -> "_Pace":
        curves = predicted_curves(motion, agents)
        first = motion.velocity_mps[:, agents, 0].norm(dim=-1)
        return cls(
            curves=curves,
            along_m=curves.along_m,
            speed_mps=speeds(curves.along_m, first, motion.step_s),
            step_s=motion.step_s,
        )

    def changed(self, along_m: Float[Tensor, "S G T"]) -> Bool[Tensor, "S G 1"]:
        """Whether a retimed motion differs from the predicted one."""
        gap = (along_m - self.along_m).abs().amax(dim=-1, keepdim=True)
        # A retimed prediction that differs by less is met.
        return gap > 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedTerm(AgentsTerm):
    """Reaches and keeps a speed."""

    @cached_property
    def _may_stay(self) -> Bool[Tensor, "G 1"]:
        """Stationary agents that are not named."""
        standing = torch.from_numpy(self.guided.context.is_standing)
        standing = standing.to(self.agents.device)[self.agents]
        is_named = [bool(term.agent_ids) for term in self.guided.values]
        return (standing & ~torch.tensor(is_named, device=standing.device))[:, None]

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to a ramp to the speed along the predicted or planned path."""
        pace = _Pace.of(motion, self.agents)
        first = pace.speed_mps[..., :1]
        change = self.guided.of_each("speed_mps") - first
        # Share of the time in which a target speed should be reached.
        needed = change.abs() / (0.6 * motion.time_s[-1])
        rate = torch.where(
            change > 0,
            needed.clamp(ACCELERATION_MPS2, FIRM_ACCELERATION_MPS2),
            needed.clamp(LIMIT_BRAKING_MPS2, MAX_BRAKING_MPS2),
        )
        done = (rate * motion.time_s).minimum(change.abs())
        along = distances(first + change.sign() * done, motion.step_s)
        stays = self._may_stay & (pace.along_m[..., -1:] < STAYS_M)
        wanted = pace.changed(along) & ~stays
        curves = extended(pace.curves, self.guided)
        return _retimed(self, curves, along, motion, self.config.speed_mps, wanted)


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitTerm(AgentsTerm):
    """Keeps a speed limit."""

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals of the agents that are predicted to exceed the limit."""
        config, pace = self.config, _Pace.of(motion, self.agents)
        limit = self.guided.of_each("speed_mps") - config.speed_mps
        limit = limit.clamp_min(0.0)
        # The current speed is given, and may be above the limit.
        lost = LIMIT_BRAKING_MPS2 * motion.time_s
        cap = (pace.speed_mps[..., :1] - lost).maximum(limit)
        kept = pace.speed_mps.minimum(cap)
        along = distances(kept, motion.step_s)
        is_over = (pace.speed_mps[..., 1:] > limit).any(dim=-1, keepdim=True)
        wanted = is_over & pace.changed(along)
        return _retimed(self, pace.curves, along, motion, config.speed_mps, wanted)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComfortTerm(AgentsTerm):
    """Keeps limits of acceleration, braking and lateral acceleration."""

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals at the steps at which a limit is exceeded; paths are held."""
        config, agents = self.config, self.agents
        heading = motion.heading_rad[:, agents]
        ahead = torch.stack([heading.cos(), heading.sin()], dim=-1)
        left = torch.stack([-heading.sin(), heading.cos()], dim=-1)
        position = (motion.position_m[:, agents] * left).sum(-1)
        along, across = (
            (motion.acceleration_mps2[:, agents] * one).sum(-1) for one in (ahead, left)
        )
        margin, most = 2 * config.box_m, self.guided.of_each
        kept = along.minimum(most("max_acceleration_mps2") - margin)
        kept = kept.maximum(margin - most("max_braking_mps2"))
        bent = across.minimum(most("max_lateral_mps2") - margin)
        bent = bent.maximum(margin - most("max_lateral_mps2"))
        exceeds = (kept != along) | (bent != across)
        held = exceeds.any(dim=-1, keepdim=True).expand_as(exceeds)
        return [
            ResidualRows(
                agents=agents,
                order=order,
                direction=direction,
                target=target,
                weight=torch.where(
                    wanted, row_weights(accepted, self.guided.weight, target), 0.0
                ),
            )
            for order, direction, target, accepted, wanted in (
                (2, ahead, kept, config.box_m, kept != along),
                (2, left, bent, config.box_m, bent != across),
                (0, left, position, 2 * config.path_m, held),
            )
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class StopTerm(AgentsTerm):
    """Stops in front of a line, if the agent would cross it."""

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to a stop with constant braking."""
        pace = _Pace.of(motion, self.agents)
        curves = extended(pace.curves, self.guided)
        stop_m, exists = self._place(curves, motion)
        stopped, crosses = self._stopped(pace, stop_m, motion.time_s, 0)
        for harder in range(1, _NUM_RATES):
            # Braking as late and as hard as it takes to stand within the time.
            later, _ = self._stopped(pace, stop_m, motion.time_s, harder)
            stands = stopped[..., -5:].diff(dim=-1).amax(dim=-1) < 0.01
            stopped = torch.where(stands[..., None], stopped, later)
        crosses = crosses & exists
        wanted = crosses & pace.changed(stopped)
        return _retimed(self, curves, stopped, motion, self.config.stop_m, wanted)

    def _stopped(
        self,
        pace: _Pace,
        stop_m: Float[Tensor, "S G 1"],
        time_s: Float[Tensor, "T"],
        harder: int,
    ) -> tuple[Float[Tensor, "S G T"], Bool[Tensor, "S G 1"]]:
        """Arc lengths of a stop with constant braking, and whether one is needed."""
        share = harder / (_NUM_RATES - 1)
        hard = HARDEST_BRAKING_MPS2 / 2
        braking = LIMIT_BRAKING_MPS2 + (hard - LIMIT_BRAKING_MPS2) * share
        speed, along = pace.speed_mps, pace.along_m
        is_late = along + speed.square() / (2 * braking) >= stop_m
        first = is_late.to(torch.uint8).argmax(dim=-1, keepdim=True)
        begin, rate = along.gather(-1, first), speed.gather(-1, first)
        least = rate.square() / (2 * MAX_BRAKING_MPS2)
        gap = (stop_m - begin).maximum(least).clamp_min(0.0)
        duration = 2 * gap / rate.clamp_min(0.1)
        since = time_s - time_s[first]
        done = (since / duration.clamp_min(0.1)).clamp(0, 1)
        braked = begin + gap * (1 - (1 - done) ** 2)
        # Without a late step the agent stops, or ends, before the line by itself.
        needed = is_late.any(dim=-1, keepdim=True)
        return torch.where(since < 0, along, braked), needed

    def _place(
        self, curves: Curves, motion: PredictedMotion
    ) -> tuple[Float[Tensor, "S G 1"], Bool[Tensor, "S G 1"]]:
        """Arc length at which the agent stands in front of the line, if it crosses it."""
        line = self.guided.of_each("line_m")
        first, across = line[:, :1], line[:, 1:] - line[:, :1]
        length = across.norm(dim=-1)
        across = across / length[..., None]
        normal = torch.stack([-across[..., 1], across[..., 0]], dim=-1)
        gap = curves.points_m - first
        side, place = (gap * normal).sum(-1), (gap * across).sum(-1)
        crosses = side[..., :-1] * side[..., 1:] <= 0
        near = (place > -_BESIDE_LINE_M) & (place < length + _BESIDE_LINE_M)
        crosses = crosses & (near[..., :-1] | near[..., 1:])
        node = crosses.to(torch.uint8).argmax(dim=-1, keepdim=True)
        before, after = side.gather(-1, node), side.gather(-1, node + 1)
        share = before / (before - after).abs().clamp_min(1e-4) * before.sign()
        low, high = curves.along_m.gather(-1, node), curves.along_m.gather(-1, node + 1)
        along = torch.lerp(low, high, share.abs().clamp(0, 1))
        index = node[..., None].expand(*node.shape, 2)
        course = curves.direction.gather(-2, index)
        ahead = (course * normal).sum(-1).abs().clamp_min(0.3)
        half = motion.size_m[self.agents] / 2
        beside = (course * across).sum(-1).abs()
        reach = half[:, :1] + half[:, 1:] * beside / ahead
        front = reach + STANDING_GAP_M / ahead
        return along - front, crosses.any(dim=-1, keepdim=True)


def _retimed(
    term: AgentsTerm,
    curves: Curves,
    along_m: Float[Tensor, "S G T"],
    motion: PredictedMotion,
    accepted: float,
    is_wanted: Bool[Tensor, "S G #T"],
) -> Sequence[ResidualRows]:
    """Residuals to other times on the same path, accepted in m and m/s alike."""
    return TargetMotion.along(term.agents, curves, along_m, motion.step_s).rows(
        along_m=accepted,
        speed_mps=accepted,
        across_m=2 * term.config.path_m,
        strength=term.guided.weight,
        is_wanted=is_wanted,
    )


MAKERS: Final[TermMakers] = {
    TargetSpeed: together(SpeedTerm.of),
    SpeedLimit: together(LimitTerm.of),
    ComfortLimits: together(ComfortTerm.of),
    StopAtLine: together(StopTerm.of),
}
