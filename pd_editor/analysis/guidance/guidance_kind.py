"""What a kind of guidance term is, and what its checks and outcomes are made of."""

import typing
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Generic, Literal, TypeVar

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.threats.encounter import Track
from pd_editor.analysis.threats.threat_feasibility import recorded_track
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS, AgentKind
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.paths.candidate_grid import current_paths
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2
from pd_editor.scene.traffic_sample import TrafficSample

MAX_BRAKING_MPS2: Final = 5.0
LIMIT_BRAKING_MPS2: Final = 2.0
"""Braking from a current speed above a limit down to it."""
MAX_SPEED_MPS: Final = 40.0

OPENING_MPS: Final = 1.5
"""Rate at which a gap opens that is shorter than asked for now."""


@dataclass(frozen=True, kw_only=True)
class ObeyedWithin:
    """Deviations from what is asked up to which a term is obeyed."""

    goal_m: float = 1.0
    path_m: float = 0.5
    speed_mps: float = 0.5
    overrun_m: float = 0.5
    acceleration_mps2: float = 0.5
    outside_m: float = 0.3
    """Distance of a box's corner outside the road."""
    gap_m: float = 0.5


OBEYED: Final = ObeyedWithin()


_Term = TypeVar("_Term", bound=GuidanceTerm)


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentNow:
    """An agent at the current step, with the paths that it could take."""

    scenario: Scenario
    row: int
    lasts_s: float | None = None
    """Length of its trajectory; None: to the end of the scenario."""

    @property
    def name(self) -> str:
        """Name of the agent in sentences."""
        return f"agent {self.scenario.agents.ids[self.row]}"

    @property
    def subject(self) -> str:
        """Name of the agent at the start of sentences."""
        return f"Agent {self.scenario.agents.ids[self.row]}"

    @cached_property
    def position_m(self) -> Float[np.ndarray, "2"]:
        """Position."""
        return self.scenario.agents.position_m[self.row, self.scenario.current_step]

    @cached_property
    def heading_rad(self) -> float:
        """Heading."""
        agents, now = self.scenario.agents, self.scenario.current_step
        return float(agents.heading_rad[self.row, now])

    @cached_property
    def speed_mps(self) -> float:
        """Speed."""
        agents, now = self.scenario.agents, self.scenario.current_step
        return float(np.hypot(*agents.velocity_mps[self.row, now]))

    @property
    def is_driver(self) -> bool:
        """Whether the agent belongs on the road."""
        return self.scenario.agents.kinds[self.row] in LANE_FOLLOWER_KINDS

    @property
    def duration_s(self) -> float:
        """Length of trajectories."""
        axis = self.scenario.time_axis
        whole_s = axis.future_s
        return whole_s if self.lasts_s is None else self.lasts_s

    @cached_property
    def paths_m(self) -> Float[np.ndarray, "P M 2"]:
        """Paths that it could take, one point every ``SPACING_M``."""
        one, rows = self.scenario, (self.row,)
        return current_paths(
            one.road_map, one.agents, one.current_step, rows, self.duration_s
        ).paths.points_m

    def reach_m(self, time_s: float) -> tuple[float, float]:
        """Least and greatest distance that can be driven in a time."""
        speed = self.speed_mps
        stop_s = speed / MAX_BRAKING_MPS2
        braking_s = min(time_s, stop_s)
        least = speed * braking_s - MAX_BRAKING_MPS2 * braking_s**2 / 2
        gained_s = min(time_s, max(MAX_SPEED_MPS - speed, 0.0) / FIRM_ACCELERATION_MPS2)
        fastest = speed + FIRM_ACCELERATION_MPS2 * gained_s
        most = (speed + fastest) / 2 * gained_s + fastest * (time_s - gained_s)
        return least, most


class Refusal(str):
    """Why a term cannot be run at all, in one sentence."""

    __slots__ = ()


Found = Iterator[str]
"""Problems of a term in sentences: warnings, and refusals."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A run as it is planned, against which terms are checked."""

    scenario: Scenario
    terms: Sequence[GuidanceTerm] = ()
    """Terms that are in force."""
    agent_ids: Sequence[str] | None = None
    """Agents whose trajectories are generated; None: not known yet."""

    def agents(self, agent_ids: Sequence[str]) -> list[AgentNow]:
        """Agents that are there."""
        rows = self.scenario.agents.rows(agent_ids).tolist()
        return [AgentNow(scenario=self.scenario, row=row) for row in rows]

    def generates(self, agent_id: str) -> bool:
        """Whether a trajectory is known to be generated."""
        return self.agent_ids is not None and agent_id in self.agent_ids

    def keeps(self, agent_id: str) -> bool:
        """Whether a trajectory is known to be kept."""
        return self.agent_ids is not None and agent_id not in self.agent_ids


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was asked and achieved, in words and as a deviation."""

    asked: str
    achieved: str
    error: float
    unit: str
    is_obeyed: bool
    is_feasible: bool = True
    """Whether it could have been met, against what the other agent did."""
    has_no_case: bool = False
    """Whether nothing arose to which the term applies, so that a term that was infeasible
    before the run is not obeyed."""
    worst_id: str | None = None
    """The agent that the deviation is of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """A sample on its scenario."""

    scenario: Scenario
    sample: TrafficSample
    rows: Int[np.ndarray, "G"] = field(default_factory=lambda: np.zeros(0, int))
    """Rows of the agents that a term guides."""

    @property
    def step_s(self) -> float:
        """Time between two steps."""
        return self.scenario.time_axis.step_s

    @property
    def num_steps(self) -> int:
        """Number of steps, the current one included."""
        return self.sample.heading_rad.shape[1]

    def of(self, agent_ids: Collection[str], kinds: Collection[AgentKind]) -> "Driven":
        """What concerns some agents; without names, those of some kinds."""
        pairs = zip(self.sample.ids, self.sample.kinds, strict=True)
        wanted = [
            name in agent_ids if agent_ids else kind in kinds for name, kind in pairs
        ]
        return replace(self, rows=np.flatnonzero(np.array(wanted, bool)))

    def speed_mps(self) -> Float[np.ndarray, "G S"]:
        """Speeds of all agents."""
        return np.hypot(*np.moveaxis(self.sample.velocity_mps, -1, 0))

    def track(self, agent_id: str) -> Track | None:
        """Trajectory of an agent, generated or recorded; None if it is not there now."""
        scenario, sample = self.scenario, self.sample
        if agent_id not in sample.ids:
            known = scenario.agents.row_of.get(agent_id)
            is_there = scenario.agents.is_valid[:, scenario.current_step]
            if known is None or not is_there[known]:
                return None
            return recorded_track(scenario, known)
        row = sample.ids.index(agent_id)
        return Track.of(sample, row, sample.size_m[row])


@dataclass(frozen=True, eq=False)
class Tool:
    """How a term is made on the picture."""

    gesture: Literal["click", "draw", "pick"]
    """What the page does: click the road, draw a line, or pick an agent."""
    banner: str
    """What to do, after the agent's name."""
    label: str = ""
    """Name of the tool among the keys and in menus; empty: it is not among them."""
    key: str | None = None
    draw: Callable[[Scenario, str, Float[np.ndarray, "N 2"]], GuidanceTerm] | None = (
        None
    )
    """Makes the term of an agent from the points; an agent that is picked needs none.

    Raises ``EditError`` where they cannot be.
    """
    click: Callable[[Scenario, str, Float[np.ndarray, "N 2"]], GuidanceTerm] | None = (
        None
    )
    """The same from points of a line that were clicked one by one; None: as drawn."""


def _nothing(*_: Any) -> Found:
    yield from ()


@dataclass(frozen=True, kw_only=True, eq=False)
class GuidanceKind(Generic[_Term]):
    """One kind of guidance term: all that is known of it but how it guides.

    Residuals are in ``pd_editor.generation.trajectory.guidance``, by families as well.
    """

    value: type[_Term]
    title: str
    short_title: str = ""
    """Name that fits on a tool's button; empty: the title."""
    hint: str
    """What its tool does."""
    icon: str
    """Path of SVG on a grid of 20 x 20, to be clear at 16 pixels."""
    asks: Callable[[_Term], str]
    """What a term asks of its agents, after their names."""
    outcome: Callable[[_Term, Driven], Measured | None]
    """What a sample achieved, in which agents of the term are; None: it had no effect."""
    agents: frozenset[AgentKind] = ROAD_USER_KINDS
    """Kinds of the agents that a term guides which names none."""
    check: Callable[[_Term, Plan], Found] = _nothing
    """Problems of a term before a run; its agents are there."""
    clash: Callable[[_Term, GuidanceTerm, str | None, Plan], Found] = _nothing
    """Why a term and another one exclude each other; a shared agent is in words."""
    leads: bool = False
    """Whether agents are led somewhere, and so have to avoid others."""
    tool: Tool | None = None
    """None: a term needs nothing drawn."""
    usual: Callable[[Scenario, tuple[str, ...]], _Term] | None = None
    """Makes a term with usual values; None: those of the class."""
    shape: Literal["flag", "path", "line", "arrow", "badge"] = "badge"
    """Mark on the road."""
    points_m: Callable[[_Term, Scenario], Any] | None = None
    """Points of the mark; None of an arrow between two agents, and of a badge."""

    @property
    def short(self) -> str:
        """Name that fits on a tool's button."""
        return self.short_title or self.title

    def usual_term(self, scenario: Scenario, agent_ids: Sequence[str]) -> _Term:
        """A term with usual values, of a kind of which nothing is drawn."""
        ids, make = tuple(agent_ids), typing.cast("Any", self.value)
        return self.usual(scenario, ids) if self.usual else make(agent_ids=ids)


def of_several(count: int, words: str) -> str:
    """Words on the worst of several agents."""
    return words if count == 1 else f"{words} (the worst of {count} agents)"
