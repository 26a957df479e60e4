"""Guidance terms: what a user asks of the trajectories of agents, as plain values.

Terms are part of a scenario, or of one request. Points are in the scene frame, times
are seconds after the current step. Strengths of different terms compare through their
weights; a term that is off is kept but has no effect.
"""

import itertools
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Literal, TypeVar, get_args

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import is_plain, one_line
from pd_editor.scene.scene_limits import MAX_POSITION_M

MAX_TERMS: Final = 200
"""Largest number of terms of a scenario or of a request."""
MAX_WEIGHT: Final = 10.0
MAX_PATH_POINTS: Final = 1_000
MAX_TARGET_SPEED_MPS: Final = 60.0
MAX_TIME_S: Final = 60.0

Point = tuple[float, float]
Motion = Callable[[Float[np.ndarray, "P 2"]], Float[np.ndarray, "P 2"]]
"""A motion of the plane, such as a warp."""
Side = Literal["left", "right"]
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
_Term = TypeVar("_Term", bound="GuidanceBase")
_Many = TypeVar("_Many", bound="AgentsGuidance")


@dataclass(frozen=True, kw_only=True)
class GuidanceBase:
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

    @property
    def named_ids(self) -> tuple[str, ...]:
        """Ids of all agents that the term names; empty: all generated agents."""
        raise NotImplementedError

    @property
    def guided_ids(self) -> tuple[str, ...]:
        """Ids of the agents whose trajectories it changes; empty: all generated ones."""
        return self.named_ids

    @property
    def name(self) -> str:
        """Name of the kind in words, such as "goal point"."""
        return self.noun or self.kind.replace("-", " ")

    @property
    def in_words(self) -> str:
        """Name of the term with its agents, such as "goal point of agent 12"."""
        return f"{self.name} of {_agents_in_words(self.guided_ids)}"

    def moved(self: _Term, motion: Motion) -> _Term:  # noqa: ARG002
        """The term after a motion of the plane."""
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

    def _check_points(self, points_m: tuple[Point, ...]) -> None:
        for point in points_m:
            if not all(
                math.isfinite(value) and abs(value) <= MAX_POSITION_M for value in point
            ):
                raise EditError(
                    f"A point of a {self.name} is ({point[0]:g}, {point[1]:g}) m; "
                    f"expected at most {MAX_POSITION_M:g} m from the scene's origin."
                )


@dataclass(frozen=True, kw_only=True)
class AgentGuidance(GuidanceBase):
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
class AgentsGuidance(GuidanceBase):
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


@dataclass(frozen=True, kw_only=True)
class FollowPath(AgentGuidance):
    """Drive along a path, at a speed that the model chooses."""

    kind: ClassVar[str] = "follow-path"
    noun: ClassVar[str] = "path"

    points_m: tuple[Point, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 2 <= len(self.points_m) <= MAX_PATH_POINTS:
            raise EditError(
                f"A path to follow has {len(self.points_m)} points; expected 2 to "
                f"{MAX_PATH_POINTS}."
            )
        self._check_points(self.points_m)
        if _length_m(self.points_m) < 1.0:
            raise EditError("A path to follow is shorter than 1 m; draw a longer one.")

    def moved(self, motion: Motion) -> "FollowPath":
        """The term with moved points."""
        return replace(self, points_m=_moved(self.points_m, motion))


@dataclass(frozen=True, kw_only=True)
class FollowLane(AgentGuidance):
    """Drive along the centre lines of lanes, one after another."""

    kind: ClassVar[str] = "follow-lane"
    noun: ClassVar[str] = "lane route"

    lane_ids: tuple[int, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.lane_ids) <= MAX_PATH_POINTS:
            raise EditError(
                f"A lane to follow is made of {len(self.lane_ids)} lanes; expected 1 "
                f"to {MAX_PATH_POINTS}."
            )


@dataclass(frozen=True, kw_only=True)
class GoalPoint(AgentGuidance):
    """Be at a point at a time."""

    kind: ClassVar[str] = "goal-point"

    point_m: Point
    at_s: float | None = None
    """None: at the last generated step."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_points((self.point_m,))
        if self.at_s is not None:
            self._check("time", self.at_s, 0.1, MAX_TIME_S)

    def moved(self, motion: Motion) -> "GoalPoint":
        """The term with a moved point."""
        return replace(self, point_m=_moved((self.point_m,), motion)[0])


@dataclass(frozen=True, kw_only=True)
class StopAtLine(AgentGuidance):
    """Stop in front of a line that is given by its two ends."""

    kind: ClassVar[str] = "stop-at-line"
    noun: ClassVar[str] = "stop line"

    line_m: tuple[Point, Point]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_points(self.line_m)
        if not 0.5 <= _length_m(self.line_m) <= 100.0:
            raise EditError(
                f"A stop line is {_length_m(self.line_m):g} m long; expected 0.5 to "
                "100 m."
            )

    def moved(self, motion: Motion) -> "StopAtLine":
        """The term with moved ends."""
        first, last = _moved(self.line_m, motion)
        return replace(self, line_m=(first, last))


@dataclass(frozen=True, kw_only=True)
class TargetSpeed(AgentsGuidance):
    """Reach and keep a speed, within comfortable accelerations."""

    kind: ClassVar[str] = "target-speed"

    speed_mps: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("speed", self.speed_mps, 0.0, MAX_TARGET_SPEED_MPS)


@dataclass(frozen=True, kw_only=True)
class SpeedLimit(AgentsGuidance):
    """Do not exceed a speed."""

    kind: ClassVar[str] = "speed-limit"

    speed_mps: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("speed", self.speed_mps, 0.5, MAX_TARGET_SPEED_MPS)


@dataclass(frozen=True, kw_only=True)
class ComfortLimits(AgentsGuidance):
    """Do not exceed accelerations forwards, backwards and to the sides."""

    kind: ClassVar[str] = "comfort-limits"
    noun: ClassVar[str] = "comfort limit"

    max_acceleration_mps2: float = 2.5
    max_braking_mps2: float = 3.5
    max_lateral_mps2: float = 3.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for what, value in (
            ("acceleration", self.max_acceleration_mps2),
            ("braking", self.max_braking_mps2),
            ("lateral acceleration", self.max_lateral_mps2),
        ):
            self._check(what, value, 0.2, 12.0)

    @property
    def in_words(self) -> str:
        """Name of the term with its agents."""
        return f"comfort limits of {_agents_in_words(self.agent_ids)}"


@dataclass(frozen=True, kw_only=True)
class StayOnRoad(AgentsGuidance):
    """Keep boxes on the drivable area."""

    kind: ClassVar[str] = "stay-on-road"
    noun: ClassVar[str] = "stay on the road"


@dataclass(frozen=True, kw_only=True)
class KeepGap(AgentsGuidance):
    """Keep a distance between bumpers to the agent ahead."""

    kind: ClassVar[str] = "keep-gap"
    noun: ClassVar[str] = "gap"

    gap_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("distance", self.gap_m, 0.5, 200.0)


@dataclass(frozen=True, kw_only=True)
class AvoidCollisions(AgentsGuidance):
    """Keep boxes apart, by swerves to a side if one is given."""

    kind: ClassVar[str] = "avoid-collisions"
    noun: ClassVar[str] = "collision avoidance"

    side: Side | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.side is not None and self.side not in get_args(Side):
            raise EditError(
                f"The side of a swerve is {self.side!r}; expected left or right."
            )


@dataclass(frozen=True, kw_only=True)
class YieldTo(PairGuidance):
    """Let another agent pass first."""

    kind: ClassVar[str] = "yield-to"
    noun: ClassVar[str] = "yielding"

    @property
    def in_words(self) -> str:
        """Name of the term with both agents."""
        return f"yielding of agent {self.agent_id} to {self.other_id}"


@dataclass(frozen=True, kw_only=True)
class Threaten(PairGuidance):
    """Come dangerously close to another agent, which is left unchanged."""

    kind: ClassVar[str] = "threaten"
    noun: ClassVar[str] = "threat"

    severity: float = 1.0
    """0: a tight gap, 1: contact."""
    approach: Approach = "rear"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("severity", self.severity, 0.0, 1.0)
        if self.approach not in get_args(Approach):
            raise EditError(
                f"The approach of a threat is {self.approach!r}; expected one of "
                f"{', '.join(get_args(Approach))}."
            )

    @property
    def in_words(self) -> str:
        """Name of the term with both agents."""
        how = APPROACH_WORDS[self.approach]
        return f"threat of agent {self.agent_id} to {self.other_id} ({how})"


GuidanceTerm = (
    FollowPath
    | FollowLane
    | GoalPoint
    | TargetSpeed
    | SpeedLimit
    | ComfortLimits
    | StopAtLine
    | StayOnRoad
    | KeepGap
    | AvoidCollisions
    | YieldTo
    | Threaten
)
GUIDANCE_KINDS: Final[dict[str, type[GuidanceTerm]]] = {
    term.kind: term for term in get_args(GuidanceTerm)
}
"""All kinds of terms by their names in JSON and on the shell."""


def terms_without(
    terms: tuple[GuidanceTerm, ...], agent_ids: Collection[str]
) -> tuple[GuidanceTerm, ...]:
    """Terms that are left after agents are removed."""
    left = (term.without_agents(agent_ids) for term in terms)
    return tuple(term for term in left if term is not None)


def moved_terms(
    terms: tuple[GuidanceTerm, ...], motion: Motion
) -> tuple[GuidanceTerm, ...]:
    """Terms after a motion of the plane."""
    return tuple(term.moved(motion) for term in terms)


def _moved(points_m: tuple[Point, ...], motion: Motion) -> tuple[Point, ...]:
    moved = motion(np.array(points_m, float).reshape(-1, 2))
    return tuple((float(x), float(y)) for x, y in moved)


def _length_m(points_m: tuple[Point, ...]) -> float:
    return sum(itertools.starmap(math.dist, itertools.pairwise(points_m)))


def _agents_in_words(agent_ids: tuple[str, ...]) -> str:
    if not agent_ids:
        return "all agents"
    if len(agent_ids) == 1:
        return f"agent {agent_ids[0]}"
    return f"{len(agent_ids)} agents"
