"""What a threat asked for, and what came of it."""

from pd_editor.scene.guidance_outcome import TermOutcome
from pd_editor.scene.guidance_terms import Threaten
from pd_editor.threats.encounter import Encounter
from pd_editor.threats.threat_plans import GAP_TOLERANCE_M, ThreatAim


def threat_outcome(
    term: Threaten, found: Encounter, *, is_feasible: bool
) -> TermOutcome:
    """Outcome of a threat of which the encounter is known."""
    aim = ThreatAim.of(term.approach, term.severity)
    error = abs(found.counted_gap_m - aim.gap_m)
    return TermOutcome(
        term=term,
        is_feasible=is_feasible,
        asked=f"{_goal(aim)} ({term.approach})",
        achieved=encounter_in_words(found),
        error=error,
        unit="m",
        is_obeyed=meets(aim, found),
    )


def meets(aim: ThreatAim, found: Encounter) -> bool:
    """Whether an encounter is the asked near-miss or contact."""
    if aim.is_contact:
        return found.is_contact
    error = abs(found.counted_gap_m - aim.gap_m)
    return not found.is_contact and error <= GAP_TOLERANCE_M


def encounter_in_words(found: Encounter) -> str:
    """Gap or contact, side, relative speed and least time to collision."""
    what = "contact" if found.is_contact else f"gap {found.gap_m:.1f} m"
    parts = [
        f"{what} at the {found.side}, {found.at_s:.1f} s",
        f"relative speed {found.relative_speed_mps:.1f} m/s",
    ]
    time = found.least_time_to_collision_s
    if time is not None and not found.is_contact:
        parts.append(f"time to collision {time:.1f} s")
    return ", ".join(parts)


def _goal(aim: ThreatAim) -> str:
    return "contact" if aim.is_contact else f"gap {aim.gap_m:.1f} m"
