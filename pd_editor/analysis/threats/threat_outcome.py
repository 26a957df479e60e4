"""What a threat asked for, and what came of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.analysis.threats.encounter import Approach, Encounter
from pd_editor.analysis.threats.threat_plans import (
    GAP_TOLERANCE_M,
    HARD_BRAKING_MPS2,
    ThreatAim,
    ThreatObstacle,
)

_FAR_M: Final = 1e3
"""Stands for a gap that was never counted."""
_FAR_BEYOND: Final = 10.0
"""Times of the limits from which on the number tells nothing."""
_COURSES: Final[Mapping[Approach, str]] = {
    "rear": "none of the ways that it could take leads on behind {other}",
    "cut-in": "it would have to come from beside the way of {other}, in the same "
    "direction, and {other} would have to drive",
    "side": "none of the ways that it could take crosses that of {other}",
    "head-on": "none of the ways that it could take leads towards {other}",
    "brakes": "it would have to drive ahead of {other}, on its way, with none between",
    "pulls-out": "it would have to stand beside the way of {other}, ahead of it, and "
    "{other} would have to drive",
}
"""What an approach needs and no candidate has."""
OBSTACLES: Final[Mapping[str, str]] = {
    "course": "no way to that",
    "limits": "too hard",
    "road": "off the road",
    "outcome": "not at this gap",
    "traffic": "the way is blocked",
}
"""Kinds of obstacles in few words."""


@dataclass(frozen=True, kw_only=True)
class ThreatWords:
    """A threat in words, and how far it is from what was asked."""

    asked: str
    achieved: str
    error_m: float
    """Difference of the gaps."""
    is_met: bool


def threat_in_words(aim: ThreatAim, found: Encounter) -> ThreatWords:
    """Compare an encounter with what was asked."""
    goal = "contact" if aim.is_contact else f"gap {aim.gap_m:.1f} m"
    return ThreatWords(
        asked=f"{goal} ({aim.approach})",
        achieved=_in_words(found, aim.approach),
        error_m=abs(min(found.counted_gap_m, _FAR_M) - aim.gap_m),
        is_met=meets(aim, found),
    )


def meets(aim: ThreatAim, found: Encounter) -> bool:
    """Whether an encounter is the asked near-miss or contact."""
    if aim.approach == "brakes" and found.braking_mps2 < HARD_BRAKING_MPS2:
        return False
    if aim.is_contact:
        return found.is_contact
    error = abs(found.counted_gap_m - aim.gap_m)
    return not found.is_contact and error <= GAP_TOLERANCE_M


def _in_words(found: Encounter, approach: Approach) -> str:
    """Gap or contact, side, relative speed, braking and least time to collision."""
    what = "contact" if found.is_contact else f"gap {found.gap_m:.1f} m"
    parts = [
        f"{what} at the {found.side} after {found.at_s:.1f} s",
        f"relative speed {found.relative_speed_mps:.1f} m/s",
    ]
    if approach == "brakes":
        parts.append(f"braking {found.braking_mps2:.1f} m/s2")
    time = found.least_time_to_collision_s
    if time is not None and not found.is_contact:
        parts.append(f"time to collision {time:.1f} s")
    return ", ".join(parts)


def obstacle_in_words(
    obstacle: ThreatObstacle, approach: Approach, other: str, duration_s: float
) -> str:
    """Why a threat cannot be carried out, after the name of the agent."""
    times = obstacle.times_limits
    if obstacle.kind == "course":
        return _COURSES[approach].format(other=other)
    if obstacle.kind == "road":
        return "each way to that leads off the road"
    if obstacle.kind == "outcome":
        return f"each of its ways passes {other} with another gap or hits it otherwise"
    if obstacle.kind == "traffic":
        return "on each of its ways it would hit an agent that does not make way"
    if np.isinf(times):
        return "it would have to turn round or reverse"
    hard = (
        f"{np.ceil(10 * times) / 10:.1f}" if times < _FAR_BEYOND else "far more than 10"
    )
    return (
        f"within {duration_s:.1f} s it would have to accelerate, brake or turn {hard} "
        "times as hard as it can"
    )
