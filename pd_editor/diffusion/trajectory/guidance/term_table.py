"""Table of the terms by their values."""

from collections.abc import Callable, Sequence
from typing import Any, Final

from pd_editor.diffusion.trajectory.guidance.interaction_terms import (
    AvoidTerm,
    GapTerm,
    YieldTerm,
)
from pd_editor.diffusion.trajectory.guidance.path_terms import GoalTerm, PathTerm
from pd_editor.diffusion.trajectory.guidance.road_terms import RoadTerm
from pd_editor.diffusion.trajectory.guidance.speed_terms import (
    ComfortTerm,
    LimitTerm,
    SpeedTerm,
    StopTerm,
)
from pd_editor.diffusion.trajectory.guidance.trajectory_term import (
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
    YieldTo,
)

TermMaker = Callable[[Sequence[Any], TermContext], Sequence[TrajectoryTerm]]
"""Makes the terms of all values of a kind; none of agents that are not sampled."""


def each(make: Callable[[Any, TermContext], TrajectoryTerm | None]) -> TermMaker:
    """Maker that makes one term of each value; None if no agent of it is sampled."""

    def made(terms: Sequence[Any], context: TermContext) -> Sequence[TrajectoryTerm]:
        found = (make(term, context) for term in terms)
        return [one for one in found if one is not None]

    return made


TERM_MAKERS: Final[dict[type[GuidanceTerm], TermMaker]] = {
    FollowPath: each(PathTerm.of_path),
    FollowLane: each(PathTerm.of_lanes),
    GoalPoint: each(GoalTerm.of),
    TargetSpeed: each(SpeedTerm.of),
    SpeedLimit: each(LimitTerm.of),
    ComfortLimits: each(ComfortTerm.of),
    StopAtLine: each(StopTerm.of),
    StayOnRoad: each(RoadTerm.of),
    KeepGap: each(GapTerm.of),
    AvoidCollisions: each(AvoidTerm.of),
    YieldTo: each(YieldTerm.of),
}
"""Maker of each kind of value. One term may guide the agents of several values: its cost
is that of its tensor operations, not of their sizes."""


def trajectory_terms(
    terms: Sequence[GuidanceTerm], context: TermContext
) -> tuple[TrajectoryTerm, ...]:
    """Terms of a run, without those that are off or of weight zero."""
    made: list[TrajectoryTerm] = []
    for kind, make in TERM_MAKERS.items():
        values = [
            term
            for term in terms
            if type(term) is kind and term.is_on and term.weight > 0
        ]
        if values:
            made += make(values, context)
    return tuple(made)
