"""Table of the terms by their values."""

from collections.abc import Callable, Sequence
from typing import Any, Final

from pd_editor.generation.trajectory.guidance.interaction_terms import (
    AvoidTerm,
    GapTerm,
    YieldTerm,
)
from pd_editor.generation.trajectory.guidance.path_terms import GoalTerm, PathTerm
from pd_editor.generation.trajectory.guidance.road_terms import RoadTerm
from pd_editor.generation.trajectory.guidance.speed_terms import (
    ComfortTerm,
    LimitTerm,
    SpeedTerm,
    StopTerm,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    TermContext,
    TrajectoryTerm,
)
from pd_editor.scene.guidance_terms import (
    AvoidCollisions,
    ComfortLimits,
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    KeepGap,
    SpeedLimit,
    StayOnRoad,
    StopAtLine,
    TargetSpeed,
    Threaten,
    YieldTo,
)

TermMaker = Callable[[Sequence[Any], TermContext], Sequence[TrajectoryTerm]]
"""Makes the terms of all values of a kind; none of agents that are not sampled."""


def together(
    make: Callable[[Sequence[Any], TermContext], TrajectoryTerm | None],
) -> TermMaker:
    """Maker of one term of all values."""

    def made(values: Sequence[Any], context: TermContext) -> Sequence[TrajectoryTerm]:
        term = make(values, context)
        return [] if term is None else [term]

    return made


def each(make: Callable[[Any, TermContext], TrajectoryTerm | None]) -> TermMaker:
    """Maker of one term of each value."""

    def made(values: Sequence[Any], context: TermContext) -> Sequence[TrajectoryTerm]:
        found = (make(value, context) for value in values)
        return [one for one in found if one is not None]

    return made


TERM_MAKERS: Final[dict[type[GuidanceTerm], TermMaker]] = {
    FollowPath: together(PathTerm.of),
    FollowLane: together(PathTerm.of),
    GoalPoint: together(GoalTerm.of),
    TargetSpeed: together(SpeedTerm.of),
    SpeedLimit: together(LimitTerm.of),
    ComfortLimits: together(ComfortTerm.of),
    StopAtLine: together(StopTerm.of),
    StayOnRoad: together(RoadTerm.of),
    KeepGap: together(GapTerm.of),
    AvoidCollisions: each(AvoidTerm.of),
    YieldTo: each(YieldTerm.of),
}
"""Maker of each kind of value."""


def trajectory_terms(
    terms: Sequence[GuidanceTerm], context: TermContext, *, avoids: bool = False
) -> tuple[TrajectoryTerm, ...]:
    """Terms of a run, without those that are off or of weight zero.

    With ``avoids``, agents that are led somewhere avoid collisions as far as they can.
    """
    made: list[TrajectoryTerm] = []
    for kind, make in TERM_MAKERS.items():
        values = [
            term
            for term in terms
            if type(term) is kind and term.is_on and term.weight > 0
        ]
        if values:
            made += make(values, context)
    if avoids:
        made += _avoidance_of_led(terms, context)
    return tuple(made)


def _avoidance_of_led(
    terms: Sequence[GuidanceTerm], context: TermContext
) -> Sequence[TrajectoryTerm]:
    """A light term of agents that are led somewhere, unless they take part in a threat."""
    active = [term for term in terms if term.is_on and term.weight > 0]
    led = {
        one.agent_id
        for one in active
        if isinstance(one, GoalPoint | FollowPath | FollowLane)
    }
    for one in active:
        if isinstance(one, Threaten):
            led -= set(one.named_ids)
    weight = context.config.led_weight
    if not led or not weight:
        return []
    value = AvoidCollisions(agent_ids=tuple(sorted(led)), weight=weight)
    term = AvoidTerm.of(value, context, is_light=True)
    return [] if term is None else [term]
