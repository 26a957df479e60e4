"""Guidance terms: what a user asks of trajectories, and what comes of it, as plain values.

Terms are part of a scenario, or of one request. Points are in the scene frame, times
are seconds after the current step. Strengths of different terms compare through their
weights; a term that is off is kept but has no effect. The kinds of terms are entries of
``pd_editor.analysis.guidance.kinds``; a scenario knows no more of them than is here.
"""

import math
import typing
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar, Final, Literal, TypeVar

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import is_plain, one_line

MAX_TERMS: Final = 200
"""Largest number of terms of a scenario or of a request."""
MAX_WEIGHT: Final = 10.0
LEAST_AT_S: Final = 0.1
MOST_AT_S: Final = 90.0
"""Earliest and latest time that a term may ask for: as long as a roll-out may last."""

Point = tuple[float, float]
Motion = Callable[[Float[np.ndarray, "P 2"]], Float[np.ndarray, "P 2"]]
"""A motion of the plane, such as a warp."""
NO_TRACK_M: Final = np.zeros((0, 2))
_Term = TypeVar("_Term", bound="GuidanceTerm")
_Many = TypeVar("_Many", bound="AgentsGuidance")


@dataclass(frozen=True, eq=False)
class Form:
    """How a user gives one value of a term: a number within bounds, or a choice.

    Annotates a field: its bounds are checked, and it has an input in lists of terms.
    """

    label: str
    """Name beside the input."""
    noun: str
    """Name in sentences."""
    unit: str = ""
    least: float = 0.0
    most: float = 0.0
    step: float = 0.5
    first: float | None = None
    """Least number that the input offers; None: the least one."""
    empty: str = ""
    """Meaning of None as a number; empty text: a number is needed."""
    choices: Mapping[Any, str] = field(default_factory=dict)
    """Values to choose among, with their words; empty for a number."""


@cache
def forms_of(term_type: "type[GuidanceTerm]") -> Mapping[str, Form]:
    """Forms of the fields that have one, by their names."""
    hints = typing.get_type_hints(term_type, include_extras=True)
    return {
        name: one
        for name, hint in hints.items()
        for one in getattr(hint, "__metadata__", ())
    }


@dataclass(frozen=True, kw_only=True)
class GuidanceTerm:
    """What all terms have: a weight and a switch."""

    kind: ClassVar[str] = ""
    """Name of the kind in JSON and on the shell."""
    noun: ClassVar[str] = ""
    """Name of the kind in sentences; empty: that of the shell, without hyphens."""

    weight: float = 1.0
    """Strength relative to the default, 0 to 10."""
    is_on: bool = True

    def __post_init__(self) -> None:
        self._check("weight", self.weight, 0.0, MAX_WEIGHT)
        for name, form in forms_of(type(self)).items():
            value = getattr(self, name)
            if form.choices and value not in form.choices:
                names = ", ".join(str(one) for one in form.choices if one is not None)
                raise EditError(
                    f"The {form.noun} of a {self.name} is {value!r}; expected one of "
                    f"{names}."
                )
            if not form.choices and not (form.empty and value is None):
                self._check(form.noun, value, form.least, form.most)

    @property
    def named_ids(self) -> tuple[str, ...]:
        """Ids of all agents that the term names; empty: all generated agents."""
        return ()

    @property
    def guided_ids(self) -> tuple[str, ...]:
        """Ids of the agents whose trajectories it changes; empty: all generated ones."""
        return self.named_ids

    @property
    def is_in_force(self) -> bool:
        """Whether it has an effect."""
        return self.is_on and self.weight > 0

    @property
    def place(self) -> tuple[str, ...]:
        """What two terms share of which the later one replaces the other."""
        return self.kind, *self.guided_ids

    @property
    def name(self) -> str:
        """Name of the kind in words, such as "goal point"."""
        return self.noun or self.kind.replace("-", " ")

    @property
    def in_words(self) -> str:
        """Name of the term with its agents, such as "goal point of agent 12"."""
        return f"{self.name} of {agents_in_words(self.guided_ids)}"

    def moved(self: _Term, motion: Motion) -> _Term:  # noqa: ARG002
        """The term after a motion of the plane."""
        return self

    def later(
        self: _Term,
        seconds: float,  # noqa: ARG002
        track_m: Float[np.ndarray, "S 2"] = NO_TRACK_M,  # noqa: ARG002
    ) -> _Term | None:
        """The term as it stands some seconds later; None if it is over.

        ``track_m`` is the way of its agent in the meantime, if it is of one agent.
        """
        return self

    def without_agents(self: _Term, agent_ids: Collection[str]) -> _Term | None:
        """The term after agents are removed; None if nothing is left of it."""
        return None if set(self.named_ids) & set(agent_ids) else self

    def _check(self, what: str, value: float, least: float, most: float) -> None:
        if not (math.isfinite(value) and least <= value <= most):
            raise EditError(
                f"The {what} of a {self.name} is {value:g}; expected {least:g} to "
                f"{most:g}."
            )

    def _check_ids(self, agent_ids: Collection[str]) -> None:
        for agent_id in agent_ids:
            if not agent_id or not is_plain(agent_id):
                raise EditError(
                    f"{one_line(agent_id)!r} cannot be the agent of a {self.name}; "
                    "expected the id of an agent."
                )


@dataclass(frozen=True, kw_only=True)
class AgentGuidance(GuidanceTerm):
    """A term of one agent."""

    agent_id: str

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_ids((self.agent_id,))

    @property
    def named_ids(self) -> tuple[str, ...]:
        """The agent's id."""
        return (self.agent_id,)


@dataclass(frozen=True, kw_only=True)
class AgentsGuidance(GuidanceTerm):
    """A term of several agents, or of all generated ones."""

    agent_ids: tuple[str, ...] = ()
    """Empty: all generated agents."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_ids(self.agent_ids)
        if len(set(self.agent_ids)) < len(self.agent_ids):
            raise EditError(f"A {self.name} names an agent twice; name each once.")

    @property
    def named_ids(self) -> tuple[str, ...]:
        """Ids of the agents."""
        return self.agent_ids

    def without_agents(self: _Many, agent_ids: Collection[str]) -> _Many | None:
        """The term of the agents that are left; None if it named removed ones only."""
        gone = set(agent_ids)
        left = tuple(name for name in self.agent_ids if name not in gone)
        if left == self.agent_ids:
            return self
        return replace(self, agent_ids=left) if left else None


@dataclass(frozen=True, kw_only=True)
class PairGuidance(AgentGuidance):
    """A term of one agent that refers to another one, which is left unchanged."""

    other_id: str

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_ids((self.other_id,))
        if self.other_id == self.agent_id:
            raise EditError(
                f"A {self.name} needs two agents; {one_line(self.agent_id)} is named "
                "twice."
            )

    @property
    def named_ids(self) -> tuple[str, ...]:
        """Ids of both agents."""
        return (self.agent_id, self.other_id)

    @property
    def guided_ids(self) -> tuple[str, ...]:
        """Id of the agent that is guided."""
        return (self.agent_id,)


def time_left_s(at_s: float | None, seconds: float) -> float | None:
    """A time of a term as it stands some seconds later; None if it is over, or is none."""
    left_s = 0.0 if at_s is None else round(at_s - seconds, 3)
    return None if left_s < LEAST_AT_S else left_s


def terms_without(
    terms: tuple[GuidanceTerm, ...], agent_ids: Collection[str]
) -> tuple[GuidanceTerm, ...]:
    """Terms that are left after agents are removed."""
    left = (term.without_agents(agent_ids) for term in terms)
    return tuple(term for term in left if term is not None)


def agents_in_words(agent_ids: tuple[str, ...]) -> str:
    """Agents that a term guides."""
    if not agent_ids:
        return "all agents"
    if len(agent_ids) == 1:
        return f"agent {agent_ids[0]}"
    return f"{len(agent_ids)} agents"


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
