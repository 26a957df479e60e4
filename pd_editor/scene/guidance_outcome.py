"""What is known of guidance terms before a run (problems) and after it (outcomes)."""

from dataclasses import dataclass
from typing import Final, Literal

from pd_editor.scene.guidance_terms import GuidanceTerm


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


MOST_WORSE: Final = Realism(
    off_road=0.02, num_collisions=0, lateral_deviation_m=0.5, acceleration_mps2=1.0
)
"""Bounds of what guidance may add to each figure."""


@dataclass(frozen=True, kw_only=True)
class GuidanceCost:
    """Realism of a guided sample, and of the unguided one of the same seed."""

    guided: Realism
    unguided: Realism

    def worse(self) -> tuple[str, ...]:
        """What guidance made worse than its bound, in words."""
        words = {
            "num_collisions": "{} instead of {} agents collide",
            "off_road": "moving agents are off the road for {:.0%} instead of {:.0%} of "
            "the time",
            "lateral_deviation_m": "agents are {:.1f} instead of {:.1f} m from their lanes",
            "acceleration_mps2": "agents accelerate with {:.1f} instead of {:.1f} m/s²",
        }
        values = {
            name: (getattr(self.guided, name), getattr(self.unguided, name))
            for name in words
        }
        return tuple(
            words[name].format(mine, other)
            for name, (mine, other) in values.items()
            if mine - other > getattr(MOST_WORSE, name)
        )

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
