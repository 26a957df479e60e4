"""Terms on pairs of agents: avoiding collisions, keeping gaps, yielding."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.analysis.guidance.guidance_kind import MAX_BRAKING_MPS2, OPENING_MPS
from pd_editor.analysis.guidance.kinds.pairs import YieldTo
from pd_editor.analysis.guidance.kinds.space import (
    FOLLOWS_COS,
    AvoidCollisions,
    KeepGap,
)
from pd_editor.analysis.metrics.box_overlaps import overlapping_pairs
from pd_editor.analysis.repair.current_states import counted
from pd_editor.analysis.repair.yielding import GAP_M
from pd_editor.generation.trajectory.guidance.latent_motion import (
    BoxTracks,
    PredictedMotion,
    beside_m,
    depth_m,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    AgentsTerm,
    ResidualRows,
    TermContext,
    TermMakers,
    each,
    row_weights,
    together,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.paths.car_following import HARDEST_BRAKING_MPS2
from pd_editor.scene.paths.suggested_state import SIDE_GAP_M

_LEAST_MARGIN_M: Final = 0.01
_GENTLE_MPS2: Final = 3.0
"""Slowing down that takes more costs more, so that agents rather swerve."""
_NEVER: Final = 1e5


@dataclass(frozen=True, kw_only=True, eq=False)
class AvoidTerm:
    """Keeps boxes apart: one agent slows down, or both move to the sides.

    Of the ways to resolve a conflict the one with the least displacement is taken, anew
    at each prediction. An agent that slows down is held before the place on its own path
    that the other one blocks.
    """

    context: TermContext
    avoids: Bool[Tensor, "A"]
    """Agents that may be moved."""
    counts: Bool[Tensor, "A A"]
    """Pairs that should not collide."""
    side: float
    """1: swerve to the left, -1: to the right, 0: whatever is less."""
    weight: float
    is_light: bool = False
    """Whether it counts in the projections of the result alone, and adds none."""
    is_closed: bool = True

    @classmethod
    def of(
        cls, term: AvoidCollisions, context: TermContext, *, is_light: bool = False
    ) -> "AvoidTerm | None":
        """Make the term; None if no agent of it is sampled.

        A light one goes with terms that lead agents somewhere: they drive there around
        others where they can. It is as good in the projections alone as in all steps
        (on ``train`` 39 instead of 36 agents collide, 40 unguided), which cost time.
        """
        agents = context.guided(term)
        if not len(agents):
            return None
        avoids = torch.zeros(len(context.ids), dtype=torch.bool, device=agents.device)
        avoids[agents] = True
        return cls(
            context=context,
            avoids=avoids,
            counts=torch.from_numpy(
                _counted_pairs(
                    context.scenario.agents, context.scenario.current_step, context.ids
                )
            ).to(agents.device),
            side={"left": 1.0, "right": -1.0, None: 0.0}[term.side],
            weight=term.weight,
            is_light=is_light,
        )

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals of agents whose boxes are predicted to overlap, or nearly so."""
        tracks = BoxTracks.of(motion, HARDEST_BRAKING_MPS2)
        either = self.avoids[:, None] | self.avoids
        sample, one, two = tracks.pairs_that_meet(self.counts & either)
        if not len(sample):
            return []
        depth = depth_m(
            tracks.position_m[sample, two] - tracks.position_m[sample, one],
            (tracks.heading_rad[sample, one], tracks.heading_rad[sample, two]),
            (tracks.size_m[one][:, None], tracks.size_m[two][:, None]),
        )
        there = tracks.exists[one] & tracks.exists[two]
        begin = there.to(torch.uint8).argmax(dim=-1, keepdim=True)
        apart = -depth.gather(-1, begin)[:, 0]
        margin, gap = self._margins(apart)
        # Pairs that overlap when one of them enters are left alone.
        matters = (apart > 0) | (begin[:, 0] == 0)
        hits = (depth + margin[:, None] > 0) & there & matters[:, None]
        some = hits.any(dim=-1)
        if not bool(some.any()):
            return []
        return self._resolved(
            tracks,
            _Conflicts(
                sample=sample[some].repeat(2),
                own=torch.cat([one[some], two[some]]),
                other=torch.cat([two[some], one[some]]),
                margin_m=margin[some].repeat(2),
                gap_m=gap[some].repeat(2),
                hits=hits[some].repeat(2, 1),
            ),
        )

    def _margins(
        self, apart_m: Float[Tensor, "P"]
    ) -> tuple[Float[Tensor, "P"], Float[Tensor, "P"]]:
        """Wanted gaps to the side and ahead: no more than there is now."""
        # Where agents are nearer now than the wanted margin, this share of their gap is
        # kept.
        now = (0.8 * apart_m).clamp_min(_LEAST_MARGIN_M)
        # Of boxes that touch now, none comes closer.
        now = torch.where(apart_m > 0, now, apart_m - _LEAST_MARGIN_M)
        return now.clamp_max(SIDE_GAP_M), now.clamp_max(2 * SIDE_GAP_M)

    def _resolved(
        self, tracks: BoxTracks, conflicts: "_Conflicts"
    ) -> Sequence[ResidualRows]:
        """Rows of the cheaper way out of each conflict."""
        slowed = _Slowing.of(tracks, conflicts)
        swerved = _Swerving.of(tracks, conflicts, self.side)
        can = self.avoids[conflicts.own]
        slowing = slowed.cost.masked_fill(~can, torch.inf)
        turns = can & swerved.is_possible
        swerving = swerved.cost.masked_fill(~turns, torch.inf)
        swerving = swerving + torch.where(
            swerved.needed_m.amax(dim=-1) > self.context.config.max_swerve_m,
            _NEVER,
            0.0,
        )
        if self.side:
            slowing = slowing + _NEVER
            swerving = swerved.needed_m.amax(dim=-1).masked_fill(~turns, torch.inf)
        # Both orders of each pair: the cheapest of four ways.
        half = len(slowing) // 2
        ways = torch.stack(
            [slowing[:half], slowing[half:], swerving[:half], swerving[half:]]
        )
        cost, way = ways.min(dim=0)
        slows = torch.cat([way == 0, way == 1]) & (cost < _NEVER).repeat(2)
        swerves = (way >= 2) & (cost < _NEVER)
        if self.side:
            share = torch.ones_like(slowing)
            moves = torch.cat([way == 2, way == 3]) & swerves.repeat(2)
        else:
            moves = swerves.repeat(2) & turns
            share = torch.where(turns.roll(half), 0.5, 1.0)
        rows: list[ResidualRows] = []
        accepted_m = self.context.config.box_m
        if bool(slows.any()):
            rows.append(
                held_rows(
                    tracks,
                    conflicts.sample[slows],
                    conflicts.own[slows],
                    slowed.last[slows],
                    accepted_m,
                    self.weight,
                )
            )
        if bool(moves.any()):
            shift = swerved.sign[:, None] * share[:, None] * swerved.needed_m
            rows.append(
                _shifted_rows(
                    tracks,
                    conflicts.sample[moves],
                    conflicts.own[moves],
                    shift[moves],
                    accepted_m,
                    self.weight,
                )
            )
        return [_at_all_steps(one, tracks, self.context) for one in rows]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Conflicts:
    """Q conflicts of an agent with another one; the second half is the other way round."""

    sample: Int[Tensor, "Q"]
    own: Int[Tensor, "Q"]
    other: Int[Tensor, "Q"]
    margin_m: Float[Tensor, "Q"]
    gap_m: Float[Tensor, "Q"]
    hits: Bool[Tensor, "Q K"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Slowing:
    """How far each agent can go on its own path at each step; K: unhindered."""

    last: Int[Tensor, "Q K"]
    cost: Float[Tensor, "Q"]

    @classmethod
    def of(cls, tracks: BoxTracks, conflicts: _Conflicts) -> "_Slowing":
        """Agents stay before what the other one blocks; infinite cost: impossible."""
        sample, own = conflicts.sample, conflicts.own
        blocked = tracks.blocked(
            sample, own, conflicts.other, (conflicts.gap_m, conflicts.margin_m)
        )
        count = len(tracks.step)
        index = torch.arange(count, device=own.device)
        first = torch.where(blocked, index[:, None], count).amin(dim=1)
        reaches = index >= first
        last = first - 1
        path = tracks.position_m[sample, own]
        place = last.clamp_min(0)[..., None].expand(-1, -1, 2)
        back = (path - path.gather(1, place)).norm(dim=-1) * reaches
        is_in_the_way = (reaches & (last < 0)).any(dim=-1)
        last = torch.where(reaches, last.clamp_min(0), count)
        rate = tracks.braking_mps2(sample, own, last)
        cost = back.amax(dim=-1) + 3 * (rate - _GENTLE_MPS2).clamp_min(0).square()
        return cls(
            last=last,
            cost=cost.masked_fill(is_in_the_way, torch.inf),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Swerving:
    """How far each agent must move to a side at each step."""

    sign: Float[Tensor, "Q"]
    """1: to the left."""
    needed_m: Float[Tensor, "Q K"]
    cost: Float[Tensor, "Q"]
    is_possible: Bool[Tensor, "Q"]
    """Whether the agent drives far enough before: standing agents cannot swerve."""

    @classmethod
    def of(cls, tracks: BoxTracks, conflicts: _Conflicts, side: float) -> "_Swerving":
        """Move to the side on which the agent is at the first hit, or to a given one."""
        sample, own, other = conflicts.sample, conflicts.own, conflicts.other
        heading = tracks.heading_rad[sample, own]
        turn = tracks.heading_rad[sample, other] - heading
        offset = tracks.position_m[sample, other] - tracks.position_m[sample, own]
        sizes = tracks.size_m[own][:, None], tracks.size_m[other][:, None]
        turned = turn.cos().abs(), turn.sin().abs()
        ahead, aside, length, width = beside_m(offset, heading, turned, sizes)
        beside = ahead.abs() < length + conflicts.gap_m[:, None]
        first = conflicts.hits.to(torch.uint8).argmax(dim=-1, keepdim=True)
        place = aside.gather(1, first)[:, 0]
        sign = torch.where(place > 0, -1.0, 1.0)
        if side:
            sign = torch.full_like(sign, side)
        reach = width + conflicts.margin_m[:, None]
        needed = (reach + sign[:, None] * aside).clamp_min(0) * beside
        most = needed.amax(dim=-1)
        # Metres of slowing down that a metre of swerving is worth.
        cost = 3.0 * (most + most.square())
        # Agents swerve around others of about the same or the opposite heading only.
        crosses = turned[0].gather(1, first)[:, 0] < 0.8
        left = torch.stack([-heading.sin(), heading.cos()], dim=-1)
        moved = (sign[:, None] * needed)[..., None] * left
        # Additional cost of a swerve into a third agent.
        cost = cost + 20.0 * _hits_others(tracks, conflicts, moved)
        way = (tracks.position_m - tracks.position_m[:, :, :1]).norm(dim=-1)[
            sample, own
        ]
        # Least way forward per way to the side.
        return cls(
            sign=sign,
            needed_m=needed,
            cost=cost + torch.where(crosses, _NEVER, 0.0),
            is_possible=(way >= 2.0 * needed).all(dim=-1),
        )


def _hits_others(
    tracks: BoxTracks, conflicts: _Conflicts, shift_m: Float[Tensor, "Q K 2"]
) -> Bool[Tensor, "Q"]:
    """Whether agents that move aside would newly overlap third agents."""
    sample, own = conflicts.sample, conflicts.own
    every = torch.arange(len(tracks.size_m), device=own.device)
    heading = tracks.heading_rad[sample, own][:, None]
    offset = tracks.position_m[sample] - tracks.position_m[sample, own][:, None]
    headings = (heading, tracks.heading_rad[sample])
    sizes = (tracks.size_m[own][:, None, None], tracks.size_m[None, :, None])
    moves = shift_m.square().sum(-1) > 0
    newly = depth_m(offset - shift_m[:, None], headings, sizes) > 0
    newly = newly & (depth_m(offset, headings, sizes) <= 0) & moves[:, None]
    third = (every != own[:, None]) & (every != conflicts.other[:, None])
    return (newly & tracks.exists & third[..., None]).any(dim=-1).any(dim=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class YieldTerm:
    """Lets another agent pass first at the place where both paths meet."""

    context: TermContext
    agents: Int[Tensor, "1"]
    other: int
    weight: float
    is_closed: bool = True

    @classmethod
    def of(cls, term: YieldTo, context: TermContext) -> "YieldTerm | None":
        """Make the term; None if the agent is not sampled, or the other is not there."""
        agents = context.guided(term)
        other = context.index_of(term.other_id)
        if not len(agents) or other is None:
            return None
        return cls(context=context, agents=agents, other=other, weight=term.weight)

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals that hold the agent before what the other one will still block."""
        config = self.context.config
        tracks = BoxTracks.of(motion, HARDEST_BRAKING_MPS2)
        count, size = len(tracks.step), motion.num_samples
        sample = torch.arange(size, device=self.agents.device)
        own = self.agents.expand(size)
        like = motion.size_m
        blocked = tracks.blocked(
            sample,
            own,
            torch.full_like(own, self.other),
            (
                like.new_full((size,), GAP_M),
                like.new_full((size,), SIDE_GAP_M),
            ),
        )
        last = last_places(blocked)
        is_in_the_way = (last < 0).any(dim=-1, keepdim=True)
        last = torch.where(is_in_the_way, count, last)
        if not bool((last < count).any()):
            return []
        rows = held_rows(tracks, sample, own, last, config.box_m, self.weight)
        return [_at_all_steps(rows, tracks, self.context)]


def last_places(blocked: Bool[Tensor, "P K K"]) -> Int[Tensor, "P K"]:
    """Last step of its own path that an agent may have reached at each step.

    It stays before every place that the other one blocks then or later. K: unhindered;
    -1: it stands in the other one's way.
    """
    count = blocked.shape[-1]
    index = torch.arange(count, device=blocked.device)
    first = torch.where(blocked, index[:, None], count).amin(dim=1)
    later = first.flip(-1).cummin(dim=-1).values.flip(-1)
    return torch.where(index >= later, later - 1, count)


@dataclass(frozen=True, kw_only=True, eq=False)
class GapTerm(AgentsTerm):
    """Keeps a distance between bumpers to the agent ahead."""

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals of agents that are predicted to be nearer to their leader."""
        gap, first = gaps_ahead(motion, self.agents)
        asked = self.guided.of_each("gap_m")
        shorter = first.minimum(asked)
        wanted = (shorter + OPENING_MPS * motion.time_s).minimum(asked)
        position = motion.position_m[:, self.agents]
        heading = motion.heading_rad[:, self.agents]
        forward = torch.stack([heading.cos(), heading.sin()], dim=-1)
        # Agents brake as hard as they may at most, and wait rather than reverse.
        moved = ((position - position[:, :, :1]) * forward).sum(-1)
        braking, time_s = MAX_BRAKING_MPS2, motion.time_s
        speed = motion.velocity_mps[:, self.agents, :1].norm(dim=-1)
        lasts = time_s.minimum(speed / braking)
        least = speed * lasts - braking / 2 * lasts.square()
        short = (wanted - gap).minimum(moved - least).clamp_min(0)
        place = (position * forward).sum(-1)
        weight = row_weights(self.config.stop_m, self.guided.weight, place)
        if not bool((short > 0).any()):
            return []
        return [
            ResidualRows(
                agents=self.agents,
                order=0,
                direction=forward,
                target=place - short,
                weight=torch.where(short > 0, weight, 0.0),
            )
        ]


def gaps_ahead(
    motion: PredictedMotion, agents: Int[Tensor, "G"]
) -> tuple[Float[Tensor, "S G T"], Float[Tensor, "S G T"]]:
    """Gap to the leader at each step, and its gap at the current step; else infinite.

    The leader is the nearest agent ahead in the corridor of the agent's box, with about
    the same heading, that is not beside it then and now.
    """
    heading = motion.heading_rad
    offset = motion.position_m[:, None] - motion.position_m[:, agents, None]
    own = heading[:, agents, None]
    x, y = own.cos(), own.sin()
    ahead = offset[..., 0] * x + offset[..., 1] * y
    aside = (offset[..., 1] * x - offset[..., 0] * y).abs()
    turn = heading[:, None] - own
    cos, sin = turn.cos(), turn.sin().abs()
    size = motion.size_m[:, None]
    theirs = (size[..., 0] * cos.abs() + size[..., 1] * sin) / 2
    width = (size[..., 1] * cos.abs() + size[..., 0] * sin) / 2
    mine = motion.size_m[agents][:, None, None] / 2
    leads = (aside < width + mine[..., 1]) & (cos > FOLLOWS_COS)
    leads = leads & (ahead > mine[..., 0]) & motion.exists
    gap = ahead - theirs - mine[..., 0]
    now = gap[..., 0]
    leads = leads & ((gap > 0) | (now[..., None] > 0))
    nearest, leader = gap.masked_fill(~leads, torch.inf).min(dim=2)
    first = now.gather(2, leader.flatten(2)).clamp_min(0.0)
    return nearest, first.view_as(nearest)


def held_rows(
    tracks: BoxTracks,
    sample: Int[Tensor, "Q"],
    own: Int[Tensor, "Q"],
    last: Int[Tensor, "Q K"],
    accepted_m: float,
    strength: float,
) -> ResidualRows:
    """Rows that hold agents before places of their own paths, given by steps (K: free)."""
    samples, agents, count = tracks.position_m.shape[:3]
    least = last.new_full((samples * agents, count), count)
    index = (sample * agents + own)[:, None].expand(-1, count)
    least = least.scatter_reduce(0, index, last, "amin").view(samples, agents, count)
    # No agent can brake harder than it can.
    place = least.maximum(tracks.braked)
    # One that backs into another one is held as well.
    held = (least < count) & (place < torch.arange(count, device=own.device))
    place = place.clamp_max(count - 1)
    spot = tracks.position_m.gather(2, place[..., None].expand(*place.shape, 2))
    beyond = torch.nn.functional.normalize(tracks.position_m - spot, dim=-1)
    target = (spot * beyond).sum(-1)
    return ResidualRows(
        agents=torch.arange(agents, device=own.device),
        order=0,
        direction=beyond,
        target=target,
        weight=torch.where(held, row_weights(accepted_m, strength, target), 0.0),
    )


def _shifted_rows(
    tracks: BoxTracks,
    sample: Int[Tensor, "Q"],
    own: Int[Tensor, "Q"],
    shift_m: Float[Tensor, "Q K"],
    accepted_m: float,
    strength: float,
) -> ResidualRows:
    """Rows that move agents to the left by the largest of the shifts asked for."""
    samples, agents, count = tracks.position_m.shape[:3]
    index = (sample * agents + own)[:, None].expand(-1, count)
    none = shift_m.new_zeros(samples * agents, count)
    left = none.scatter_reduce(0, index, shift_m, "amax")
    right = none.scatter_reduce(0, index, shift_m, "amin")
    shift = torch.where(left > -right, left, right).view(samples, agents, count)
    heading = tracks.heading_rad
    aside = torch.stack([-heading.sin(), heading.cos()], dim=-1)
    target = (tracks.position_m * aside).sum(-1) + shift
    return ResidualRows(
        agents=torch.arange(agents, device=own.device),
        order=0,
        direction=aside,
        target=target,
        weight=torch.where(shift != 0, row_weights(accepted_m, strength, target), 0.0),
    )


def _at_all_steps(
    rows: ResidualRows, tracks: BoxTracks, context: TermContext
) -> ResidualRows:
    """Rows of compared steps as rows of all steps, of the sampled agents they move."""
    moved = (rows.weight > 0).any(dim=-1).any(dim=0).cpu().numpy() & context.is_sampled
    agents = torch.from_numpy(np.flatnonzero(moved)).to(tracks.step.device)
    count = int(tracks.step[-1]) + 1

    def spread(values: Tensor) -> Tensor:
        some = values[:, agents]
        table = some.new_zeros(*some.shape[:2], count, *some.shape[3:])
        table[:, :, tracks.step] = some
        return table

    return ResidualRows(
        agents=agents,
        order=rows.order,
        direction=spread(rows.direction),
        target=spread(rows.target),
        weight=spread(rows.weight),
    )


@lru_cache(maxsize=8)
def _counted_pairs(
    agents: AgentTracks, step: int, ids: tuple[str, ...]
) -> Bool[np.ndarray, "A A"]:
    """Pairs of agents that should not collide: those that do not now.

    They stay the same while a goal is dragged.
    """
    one, two = np.triu_indices(len(ids), 1)
    rows = agents.rows(ids)
    found = np.zeros((len(agents), len(agents)), bool)
    found[rows[one], rows[two]] = counted(
        agents, np.stack([rows[one], rows[two]], axis=-1)
    )
    found |= found.T
    colliding = overlapping_pairs(agents, step)
    found[colliding, colliding[:, ::-1]] = False
    return found[np.ix_(rows, rows)]


MAKERS: Final[TermMakers] = {
    KeepGap: together(GapTerm.of),
    AvoidCollisions: each(AvoidTerm.of),
    YieldTo: each(YieldTerm.of),
}
