"""Kinds of terms on the space around an agent: the road, gaps, collisions."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.guidance.guidance_kind import (
    MAX_BRAKING_MPS2,
    OBEYED,
    OPENING_MPS,
    Driven,
    Found,
    GuidanceKind,
    Measured,
    Plan,
    of_several,
)
from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.road import way_back_m
from pd_editor.analysis.metrics.traffic_view import generated_traffic
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import BoxStates, box_corners
from pd_editor.scene.guidance_terms import AgentsGuidance, Form
from pd_editor.scene.thresholds import STANDING_MPS

FOLLOWS_COS: Final = 0.5
"""A leader's heading differs by less than 60 degrees."""
ROAD_STRIDE: Final = 3
"""Stride of the steps at which boxes are tested."""


@dataclass(frozen=True, kw_only=True)
class StayOnRoad(AgentsGuidance):
    """Keep boxes on the drivable area."""

    kind: ClassVar[str] = "stay-on-road"
    noun: ClassVar[str] = "stay on the road"


def _road_outcome(_: StayOnRoad, driven: Driven) -> Measured | None:
    sample = driven.sample
    steps = slice(0, None, ROAD_STRIDE)
    position = sample.position_m[driven.rows, steps]
    size = np.broadcast_to(sample.size_m[driven.rows, None], position.shape)
    heading = sample.heading_rad[driven.rows, steps]
    way = way_back_m(driven.scenario, box_corners(position, heading, size), heading)
    outside = np.linalg.norm(way, axis=-1).max(axis=-1)
    # Agents that begin off the road, as on parking lots, are not asked to come back.
    outside = outside[outside[:, 0] == 0]
    worst = float(outside.max(initial=0.0))
    return Measured(
        asked="boxes on the road",
        achieved="on the road" if worst == 0 else f"a corner {worst:.1f} m outside",
        error=worst,
        unit="m",
        is_obeyed=worst <= OBEYED.outside_m,
    )


ROAD: Final = GuidanceKind(
    value=StayOnRoad,
    title="Stay on the road",
    short_title="On road",
    hint="Keep to the drivable area",
    icon="M4.5 17 7.7 3M15.5 17 12.3 3M10 3.5v2.2M10 8.7v2.6M10 14.2v2.6",
    asks=lambda _: "stay on the road",
    outcome=_road_outcome,
    agents=LANE_FOLLOWER_KINDS,
)


@dataclass(frozen=True, kw_only=True)
class KeepGap(AgentsGuidance):
    """Keep a distance between bumpers to the agent ahead."""

    kind: ClassVar[str] = "keep-gap"
    noun: ClassVar[str] = "gap"

    gap_m: Annotated[float, Form("Gap", "distance", unit="m", least=0.5, most=200.0)]


def _gap_problems(term: KeepGap, plan: Plan) -> Found:
    """Whether named agents stand behind others that stand: they cannot reverse."""
    agents, now = plan.scenario.agents, plan.scenario.current_step
    rows = agents.rows(term.agent_ids)
    speed = agents.speed_mps()[:, now]
    boxes = agents.at_steps(slice(now, now + 1))
    stands = boxes.is_valid & (speed < STANDING_MPS)[:, None]
    gap, _ = gaps_ahead(boxes, rows)
    standing, _ = gaps_ahead(replace(boxes, is_valid=stands), rows)
    for row, (one,), (other,) in zip(rows, gap, standing, strict=True):
        if stands[row] and one == other < term.gap_m:
            yield (
                f"Agent {agents.ids[row]} stands {one:.1f} m behind an agent that stands "
                f"as well, and cannot reverse to a gap of {term.gap_m:g} m; ask for less "
                "or name agents that drive."
            )


def _gap_outcome(term: KeepGap, driven: Driven) -> Measured | None:
    """Least gap to the agent ahead, where it could have been the asked one."""
    view = generated_traffic(driven.scenario, driven.sample)
    gap, first = gaps_ahead(view.everyone, driven.rows)
    time_s = driven.step_s * np.arange(gap.shape[1])
    asked = np.minimum(np.minimum(first, term.gap_m) + OPENING_MPS * time_s, term.gap_m)
    missing = np.where(np.isfinite(gap), asked - gap, -np.inf)
    could_wait = _could_wait_m(view.everyone, driven.rows, time_s)
    short = np.minimum(missing, could_wait)[:, 1:]
    words = f"at least {term.gap_m:.1f} m to the agent ahead"
    if not np.isfinite(short).any():
        return Measured(
            asked=words, achieved="no agent ahead", error=0.0, unit="m", is_obeyed=True
        )
    worst = max(float(short.max()), 0.0)
    is_obeyed = worst <= OBEYED.gap_m
    row, step = np.unravel_index(short.argmax(), short.shape)
    least = gap[row, step + 1]
    achieved = f"{least:.1f} m"
    if is_obeyed and least < term.gap_m - OBEYED.gap_m:
        opens = missing[row, 1:].max() <= OBEYED.gap_m
        achieved += (
            f", opening from {first[row, step + 1]:.1f} m"
            if opens
            else ", and could not leave more"
        )
    follows = int(np.isfinite(gap).any(axis=1).sum())
    return Measured(
        asked=words,
        achieved=of_several(follows, achieved),
        error=worst,
        unit="m",
        is_obeyed=is_obeyed,
    )


def _could_wait_m(
    agents: AgentStates, rows: Int[np.ndarray, "G"], time_s: Float[np.ndarray, "H"]
) -> Float[np.ndarray, "G H"]:
    """How much less agents could have driven: they brake at most, and do not reverse."""
    way = np.linalg.norm(np.diff(agents.position_m[rows], axis=1), axis=-1)
    speed = np.hypot(*agents.velocity_mps[rows, 0].T)[:, None]
    lasts = np.minimum(time_s, speed / MAX_BRAKING_MPS2)
    least = speed * lasts - MAX_BRAKING_MPS2 / 2 * lasts**2
    return np.maximum(np.pad(way.cumsum(axis=1), [(0, 0), (1, 0)]) - least, 0.0)


def gaps_ahead(
    agents: BoxStates, rows: Int[np.ndarray, "G"]
) -> tuple[Float[np.ndarray, "G H"], Float[np.ndarray, "G H"]]:
    """Gap to the leader at each step, and its gap at the current step; else infinite.

    The leader is the nearest agent ahead in the corridor of the agent's box, with about
    the same heading, that is not beside it then and now.
    """
    forward = unit_vector(agents.heading_rad[rows])[:, None]
    offset = agents.position_m[None] - agents.position_m[rows, None]
    ahead = (offset * forward).sum(-1)
    aside = np.abs((offset * left_of(forward)).sum(-1))
    turn = agents.heading_rad[None] - agents.heading_rad[rows, None]
    cos, sin = np.cos(turn), np.abs(np.sin(turn))
    length, width = agents.size_m.T[:, None, :, None] / 2
    half = length * np.abs(cos) + width * sin
    wide = width * np.abs(cos) + length * sin
    mine = agents.size_m[rows, None, None] / 2
    leads = (aside < wide + mine[..., 1]) & (cos > FOLLOWS_COS)
    leads &= (ahead > mine[..., 0]) & agents.is_valid[None]
    gap = ahead - half - mine[..., 0]
    leads &= (gap > 0) | (gap[..., :1] > 0)
    first = np.maximum(gap[..., 0], 0.0)
    gap = np.where(leads, gap, np.inf)
    leader = gap.argmin(axis=1)
    return gap.min(axis=1, initial=np.inf), np.take_along_axis(first, leader, axis=1)


GAP: Final = GuidanceKind(
    value=KeepGap,
    title="Keep a gap",
    short_title="Gap",
    hint="Keep a distance to the agent ahead",
    icon="M3 4.5v11M17 4.5v11M6 10h8M8 7.8 5.8 10 8 12.2M12 7.8l2.2 2.2-2.2 2.2",
    asks=lambda term: f"keep {term.gap_m:g} m to the agent ahead",
    outcome=_gap_outcome,
    agents=LANE_FOLLOWER_KINDS,
    check=_gap_problems,
    usual=lambda _, ids: KeepGap(agent_ids=ids, gap_m=10.0),
)


@dataclass(frozen=True, kw_only=True)
class AvoidCollisions(AgentsGuidance):
    """Keep boxes apart, by swerves to a side if one is given."""

    kind: ClassVar[str] = "avoid-collisions"
    noun: ClassVar[str] = "collision avoidance"

    side: Annotated[
        Literal["left", "right"] | None,
        Form(
            "Swerve",
            "side",
            choices={None: "either side", "left": "left", "right": "right"},
        ),
    ] = None


def _collision_outcome(_: AvoidCollisions, driven: Driven) -> Measured:
    """Number of agents that collide after t = 0, but not at t = 0 already."""
    newly = box_overlap(generated_traffic(driven.scenario, driven.sample)).newly()
    count = int((newly.value.astype(bool) & newly.is_valid)[driven.rows].sum())
    agents = "agent collides" if count == 1 else "agents collide"
    return Measured(
        asked="no collision after t = 0",
        achieved=f"{count} {agents}" if count else "no collision after t = 0",
        error=float(count),
        unit="agents",
        is_obeyed=count == 0,
    )


AVOID: Final = GuidanceKind(
    value=AvoidCollisions,
    title="Avoid collisions",
    short_title="Avoid",
    hint="Keep apart from other agents",
    icon="M10.5 17.5c0-6-5.5-4-5.5-10V4M2.8 6.2 5 4l2.2 2.2M12 8.5l5 5M17 8.5l-5 5",
    asks=lambda term: (
        f"avoid collisions{'' if term.side is None else f', swerve to the {term.side}'}"
    ),
    outcome=_collision_outcome,
)
