"""Encounter of two agents (gap, time to collision, contact), and limits of motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.analysis.metrics.motion import TURNING_MPS
from pd_editor.analysis.metrics.safety import HORIZON_S, box_gap_m, sweep_times_s
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import Boxes

_SPAN: Final = 3
"""Accelerations are second differences over this number of steps to either side."""


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Largest accelerations, curvature and speed of a kind of agent."""

    acceleration_mps2: float
    braking_mps2: float
    lateral_mps2: float
    curvature_1pm: float
    speed_mps: float


_OF_VEHICLES: Final = MotionLimits(
    acceleration_mps2=4.0,
    braking_mps2=8.0,
    lateral_mps2=6.0,
    curvature_1pm=0.2,
    speed_mps=35.0,
)
LIMITS: Final[dict[AgentKind, MotionLimits]] = {
    AgentKind.BUS: MotionLimits(
        acceleration_mps2=2.0,
        braking_mps2=6.0,
        lateral_mps2=3.5,
        curvature_1pm=0.1,
        speed_mps=28.0,
    ),
    AgentKind.CYCLIST: MotionLimits(
        acceleration_mps2=2.0,
        braking_mps2=5.0,
        lateral_mps2=4.0,
        curvature_1pm=0.5,
        speed_mps=12.0,
    ),
    AgentKind.PEDESTRIAN: MotionLimits(
        acceleration_mps2=2.0,
        braking_mps2=3.0,
        lateral_mps2=3.0,
        curvature_1pm=np.inf,
        speed_mps=4.0,
    ),
}
"""Limits of kinds that differ from vehicles."""


def limits_of(kind: AgentKind) -> MotionLimits:
    """Limits of a kind of agent."""
    return LIMITS.get(kind, _OF_VEHICLES)


@dataclass(frozen=True, kw_only=True, eq=False)
class Exertion:
    """How much of its limits each of N trajectories uses; above 1 is not possible."""

    share: Float[np.ndarray, "N"]
    """Largest share of any limit at any step."""
    effort: Float[np.ndarray, "N"]
    """Mean square of the acceleration's share of its limits."""
    largest_mps2: Float[np.ndarray, "N"]

    @property
    def is_possible(self) -> Bool[np.ndarray, "N"]:
        """Whether all limits are kept."""
        return self.share <= 1


def exertion(
    position_m: Float[np.ndarray, "N H 2"],
    velocity_mps: Float[np.ndarray, "2"],
    heading_rad: float,
    limits: MotionLimits,
    step_s: float,
    *,
    until: Int[np.ndarray, "N"] | None = None,
) -> Exertion:
    """Compare trajectories from one current state with limits.

    Before the current step the agent is taken to have kept its velocity, so that a jump
    of the velocity counts. Steps after ``until``, such as those after a collision, do
    not count.
    """
    back = np.arange(-_SPAN, 0)[:, None] * step_s * velocity_mps
    before = position_m[:, :1] + back
    path = np.concatenate([before, position_m], axis=1)
    span_s = _SPAN * step_s
    middle = path[:, _SPAN:-_SPAN]
    later, earlier = path[:, 2 * _SPAN :], path[:, : -2 * _SPAN]
    acceleration = (later - 2 * middle + earlier) / span_s**2
    velocity = (later - earlier) / (2 * span_s)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    facing = unit_vector(heading_rad)
    moves = speed > 0.5
    forward = np.where(
        moves[..., None], velocity / np.maximum(speed, 1e-6)[..., None], facing
    )
    along = (acceleration * forward).sum(-1)
    across = (
        forward[..., 0] * acceleration[..., 1] - forward[..., 1] * acceleration[..., 0]
    )
    share = np.maximum(along / limits.acceleration_mps2, -along / limits.braking_mps2)
    aside = np.abs(across) / limits.lateral_mps2
    used = np.hypot(share, aside)
    bend = np.abs(across) / np.maximum(speed, TURNING_MPS) ** 2
    bend = np.where(speed > TURNING_MPS, bend / limits.curvature_1pm, 0.0)
    fast = speed / max(limits.speed_mps, 1.05 * float(np.hypot(*velocity_mps)))
    turn = (forward[:, 1:] * forward[:, :-1]).sum(-1)
    reverses = (turn < 0) & moves[:, 1:]
    reverses |= (forward[:, 1:] @ facing < 0) & (np.arange(forward.shape[1] - 1) < 3)
    if np.isinf(limits.curvature_1pm):
        reverses = np.zeros_like(reverses)
    counts = np.ones(used.shape, bool)
    if until is not None:
        counts = np.arange(used.shape[1]) <= until[:, None]
    most = np.maximum(np.maximum(used, bend), fast)
    return Exertion(
        share=np.where(
            (reverses & counts[:, 1:]).any(axis=1),
            np.inf,
            np.where(counts, most, 0.0).max(axis=1),
        ),
        effort=np.where(counts, used**2, 0.0).sum(axis=1) / counts.sum(axis=1),
        largest_mps2=np.where(counts, np.hypot(along, across), 0.0).max(axis=1),
    )


Approach = Literal["rear", "cut-in", "side", "head-on", "brakes", "pulls-out"]
APPROACH_WORDS: Final[Mapping[Approach, str]] = {
    "rear": "from behind",
    "cut-in": "cuts in",
    "side": "crosses",
    "head-on": "head-on",
    "brakes": "brakes in front",
    "pulls-out": "pulls out",
}
"""What an agent that threatens does, wherever a person reads it."""
IN_FRONT: Final[tuple[Approach, ...]] = ("cut-in", "brakes", "pulls-out")
"""Approaches that end in front of the threatened agent, in its path."""
_BRAKING_STEPS: Final = 5
BoxSide = Literal["front", "rear", "left", "right"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A trajectory of one agent, or N of them, at H steps, the current one first."""

    position_m: Float[np.ndarray, "*N H 2"]
    heading_rad: Float[np.ndarray, "*N H"]
    velocity_mps: Float[np.ndarray, "*N H 2"]
    size_m: Float[np.ndarray, "2"]

    @classmethod
    def of(cls, states: Any, index: Any, size_m: Float[np.ndarray, "2"]) -> "Track":
        """Read trajectories at an index of the states of agents of any kind."""
        return cls(
            position_m=states.position_m[index],
            heading_rad=states.heading_rad[index],
            velocity_mps=states.velocity_mps[index],
            size_m=size_m,
        )

    def at(self, *index: Any) -> Boxes:
        """Boxes at some of the N trajectories and H steps."""
        return Boxes(
            position_m=self.position_m[index],
            heading_rad=self.heading_rad[index],
            size_m=self.size_m,
        )

    def taken(self, index: Any) -> "Track":
        """Some of N trajectories; with None, a single one as one of N = 1."""
        return Track.of(self, index, self.size_m)


@dataclass(frozen=True, kw_only=True)
class Encounter:
    """What happens between two agents after the current step."""

    gap_m: float
    """Least distance between the boxes; 0 if they touch."""
    counted_gap_m: float
    """The least distance that counts for the approach; infinite if none does."""
    at_s: float
    """Time of the first contact, or of the least distance."""
    is_contact: bool
    least_time_to_collision_s: float | None
    """At constant velocities, before contact; None if they are never on a collision
    course, or longer than ``HORIZON_S`` ahead of one."""
    relative_speed_mps: float
    """At that time."""
    braking_mps2: float
    """Hardest braking of the first agent until then."""
    side: BoxSide
    """Side of the second agent's box that the first one is at, at that time."""


def gaps_m(first: Track, second: Track) -> Float[np.ndarray, "N H"]:
    """Distances between the boxes of N first agents and of one second agent.

    Where the boxes cannot be nearest, the distance between their circumcircles is
    returned, which is a lower bound.
    """
    offset = second.position_m - first.position_m
    reach = (np.hypot(*first.size_m) + np.hypot(*second.size_m)) / 2
    gap = np.hypot(offset[..., 0], offset[..., 1]) - reach
    at_most = gap.min(axis=-1, keepdims=True, initial=np.inf) + reach
    row, step = np.nonzero(gap <= at_most)
    gap[row, step] = box_gap_m(first.at(row, step), second.at(step))
    return np.maximum(gap, 0.0)


def counted_gaps_m(
    first: Track,
    second: Track,
    gap_m: Float[np.ndarray, "N H_minus_1"],
    approach: Approach,
) -> Float[np.ndarray, "N"]:
    """Least gap that counts for an approach, of N first agents after the current step.

    Of approaches that end in front it is the gap while the first agent is in the path of
    the second one: before, it may be beside it, often nearer than that.
    """
    if approach not in IN_FRONT:
        return gap_m.min(axis=1, initial=np.inf)
    offset = (first.position_m - second.position_m)[:, 1:]
    forward = unit_vector(second.heading_rad[1:])
    turn = first.heading_rad[:, 1:] - second.heading_rad[1:]
    half = (
        np.abs(np.cos(turn)) * first.size_m[1] + np.abs(np.sin(turn)) * first.size_m[0]
    )
    aside = np.abs((offset * left_of(forward)).sum(-1))
    is_in_path = aside < (half + second.size_m[1]) / 2
    is_in_path &= (offset * forward).sum(-1) > 0
    return np.where(is_in_path | (gap_m <= 0), gap_m, np.inf).min(
        axis=1, initial=np.inf
    )


def encounter(
    first: Track, second: Track, step_s: float, approach: Approach = "rear"
) -> Encounter:
    """Measure the encounter of two agents, without the current step."""
    gap = gaps_m(first.taken(None), second)[0, 1:]
    touching = np.flatnonzero(gap <= 0)
    step = 1 + int(touching[0] if len(touching) else np.argmin(gap))
    until = step if len(touching) else len(gap)
    velocity = second.velocity_mps - first.velocity_mps
    return Encounter(
        gap_m=float(gap.min()),
        counted_gap_m=float(
            counted_gaps_m(first.taken(None), second, gap[None], approach)[0]
        ),
        at_s=step * step_s,
        is_contact=bool(len(touching)),
        least_time_to_collision_s=_least_time_s(first, second, velocity, until),
        relative_speed_mps=float(np.hypot(*velocity[step])),
        braking_mps2=float(
            hardest_braking_mps2(first.taken(None), np.array([step]), step_s)[0]
        ),
        side=side_of(first, second, step),
    )


def hardest_braking_mps2(
    track: Track, until: Int[np.ndarray, "N"], step_s: float
) -> Float[np.ndarray, "N"]:
    """Hardest braking of each of N agents until a step, over a few steps each."""
    speed = np.hypot(*np.moveaxis(track.velocity_mps, -1, 0))
    slowing = (speed[:, :-_BRAKING_STEPS] - speed[:, _BRAKING_STEPS:]) / (
        _BRAKING_STEPS * step_s
    )
    counts = np.arange(slowing.shape[1]) < until[:, None]
    return np.where(counts, slowing, 0.0).max(axis=1, initial=0.0)


def side_of(first: Track, second: Track, step: int) -> BoxSide:
    """Side of the second agent's box whose normal separates it from the first one most.

    That is the side on which a contact happens.
    """
    forward = unit_vector(second.heading_rad[step : step + 1])[0]
    ahead = unit_vector(first.heading_rad[step : step + 1])[0]
    offset = first.position_m[step] - second.position_m[step]
    best: float = -np.inf
    side: BoxSide = "front"
    length, width = first.size_m
    sides: tuple[tuple[BoxSide, Float[np.ndarray, "2"], float], ...] = (
        ("front", forward, second.size_m[0] / 2),
        ("rear", -forward, second.size_m[0] / 2),
        ("left", left_of(forward), second.size_m[1] / 2),
        ("right", -left_of(forward), second.size_m[1] / 2),
    )
    for name, normal, half in sides:
        extent = abs(ahead @ normal) * length + abs(left_of(ahead) @ normal) * width
        apart = float(offset @ normal - half - extent / 2)
        if apart > best:
            best, side = apart, name
    return side


def _least_time_s(
    first: Track, second: Track, velocity_mps: Float[np.ndarray, "H 2"], until: int
) -> float | None:
    steps = slice(0, until)
    one, other = first.at(steps), second.at(steps)
    enter, leave = sweep_times_s(one, other, velocity_mps[steps])
    apart = ~boxes_touch(one, other)
    counts = apart & (enter < leave) & (leave > 0) & (enter <= HORIZON_S)
    return float(np.maximum(enter[counts], 0).min()) if counts.any() else None
