"""What a threat asked for, and what came of it."""

from dataclasses import dataclass
from typing import Final

from pd_editor.threats.encounter import Encounter
from pd_editor.threats.threat_plans import GAP_TOLERANCE_M, ThreatAim

_FAR_M: Final = 1e3
"""Stands for a gap that was never counted."""


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
        achieved=_in_words(found),
        error_m=abs(min(found.counted_gap_m, _FAR_M) - aim.gap_m),
        is_met=meets(aim, found),
    )


def meets(aim: ThreatAim, found: Encounter) -> bool:
    """Whether an encounter is the asked near-miss or contact."""
    if aim.is_contact:
        return found.is_contact
    error = abs(found.counted_gap_m - aim.gap_m)
    return not found.is_contact and error <= GAP_TOLERANCE_M


def _in_words(found: Encounter) -> str:
    """Gap or contact, side, relative speed and least time to collision."""
    what = "contact" if found.is_contact else f"gap {found.gap_m:.1f} m"
    parts = [
        f"{what} at the {found.side} after {found.at_s:.1f} s",
        f"relative speed {found.relative_speed_mps:.1f} m/s",
    ]
    time = found.least_time_to_collision_s
    if time is not None and not found.is_contact:
        parts.append(f"time to collision {time:.1f} s")
    return ", ".join(parts)
