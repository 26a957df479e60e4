"""What is known of guidance terms before a run (problems) and after it (outcomes)."""

from dataclasses import dataclass
from typing import Final, Literal

from pd_editor.scene.guidance_terms import GuidanceTerm

MAX_WORSE_OFF_ROAD: Final = 0.02
"""Bound of the additional share of agent steps off the road."""
MAX_WORSE_COLLISIONS: Final = 0
"""Bound of additional agents in collisions."""
MAX_WORSE_LATERAL_M: Final = 0.5
"""Bound of the additional mean distance to the lanes."""
MAX_WORSE_ACCELERATION_MPS2: Final = 1.0
"""Bound of the additional mean acceleration."""


@dataclass(frozen=True, kw_only=True)
class GuidanceProblem:
    """Why a term cannot be met, or is doubtful, with what could be done."""

    term: GuidanceTerm
    severity: Literal["error", "warning"]
    """Errors are of terms that cannot be run at all."""
    message: str
    """One sentence for the user."""


@dataclass(frozen=True, kw_only=True)
class Realism:
    """Figures of one sample, over its motor vehicles and cyclists."""

    off_road: float
    """Share of the steps of those that move with the centre outside the drivable area."""
    num_collisions: int
    """Agents that newly collide with another one after t = 0."""
    lateral_deviation_m: float
    """Mean distance to the nearest reachable lane."""
    acceleration_mps2: float
    """Mean absolute acceleration."""


@dataclass(frozen=True, kw_only=True)
class GuidanceCost:
    """Realism of a guided sample, and of the unguided one of the same seed."""

    guided: Realism
    unguided: Realism

    def worse(self) -> tuple[str, ...]:
        """What guidance made worse than its bound, in words."""
        mine, other = self.guided, self.unguided
        found: list[str] = []
        if mine.num_collisions - other.num_collisions > MAX_WORSE_COLLISIONS:
            found.append(
                f"{mine.num_collisions} instead of {other.num_collisions} agents collide"
            )
        if mine.off_road - other.off_road > MAX_WORSE_OFF_ROAD:
            found.append(
                f"moving agents are off the road for {mine.off_road:.0%} instead of "
                f"{other.off_road:.0%} of the time"
            )
        further = mine.lateral_deviation_m - other.lateral_deviation_m
        if further > MAX_WORSE_LATERAL_M:
            found.append(
                f"agents are {mine.lateral_deviation_m:.1f} instead of "
                f"{other.lateral_deviation_m:.1f} m from their lanes"
            )
        harder = mine.acceleration_mps2 - other.acceleration_mps2
        if harder > MAX_WORSE_ACCELERATION_MPS2:
            found.append(
                f"agents accelerate with {mine.acceleration_mps2:.1f} instead of "
                f"{other.acceleration_mps2:.1f} m/s2"
            )
        return tuple(found)

    @property
    def is_worse(self) -> bool:
        """Whether guidance made the sample worse than a bound."""
        return bool(self.worse())


@dataclass(frozen=True, kw_only=True)
class TermOutcome:
    """What a term asked of a sample, and what the sample achieved."""

    term: GuidanceTerm
    is_feasible: bool
    """Whether it could be met within the limits of vehicles, as known before the run,
    and against what the other agent did in it."""
    asked: str
    achieved: str
    error: float
    """Deviation from what was asked; 0 is exact."""
    unit: str
    is_obeyed: bool
    is_run: bool = True
    """Whether the run had the term's agents; if not, ``achieved`` tells why not, and the
    error is not a number."""
    cost: GuidanceCost | None = None
    """Realism of the agents that the term guides, guided and unguided; None where no
    unguided sample was made."""
