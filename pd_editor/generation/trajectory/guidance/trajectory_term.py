"""Protocol of guidance terms on trajectories.

How to add a kind of term
-------------------------
1. Write a class with ``rows(motion)``. At each denoising step it gets the predicted
   motion of all agents of the scene, in the scene frame (``PredictedMotion``; agents
   that are not sampled are in it as recorded), and returns linear residuals

       r = weight * (direction . D^order(position)[step] - target)

   of the agents that it guides, with order 0 (position), 1 (velocity) or 2
   (acceleration): one ``ResidualRows`` for each group of agents or order, none if there
   is nothing to do. There is no autograd. Whatever is not linear (the nearest point of a
   path, on which side to pass, who goes first) is decided anew from each prediction.
2. Add a function that makes it from the values of the kind and the ``TermContext`` to
   ``MAKERS`` of its family of terms. A subclass of ``AgentsTerm`` says in ``of_guided``
   how it is made of the agents that all values guide, since the cost of a term is that
   of its tensor operations, not of their sizes; ``each(make)`` makes one term of each
   value. Numbers that say how strong or how wide go into ``TermGuidance`` (stored with
   the model), not into the code.

The guide sums the rows of all terms per agent, adds a prior that keeps the latents near
the network's prediction, and takes one Gauss-Newton step per denoising step. So

- a weight is the reciprocal of the deviation that one would accept (metres, m/s, ...);
  use ``row_weights`` for rows at many steps, which count as a few independent ones;
- a term that is met must return rows of zero weight (or none), not rows towards the
  present prediction, which would only hold it there;
- for speeds along a path, compute where the agent should be at each step and use
  ``TargetMotion`` (``target_motion.py``), which retimes a prediction along its own path,
  around curves as well.

Terms whose ``is_closed`` is true are met as well after the last denoising step, which
is the network's own: the result is projected to them (``TermGuide``).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.generation.defaults import check_settings
from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.paths.candidate_grid import current_paths
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class TermGuidance:
    """Strengths, accepted deviations and schedule of guidance terms."""

    spread: float = 0.15
    """How far latents may leave a prediction of low noise, in standard deviations."""
    spread_of_noise: float = 0.5
    """What is added to the spread at noise level 1; proportional to the level."""
    num_closings: int = 2
    """Projections of the result to the terms that are closed; three times as many if
    collisions are avoided: one agent that makes way may be in the way of another."""
    goal_m: float = 0.2
    """Accepted distance to a goal point, and of a box's corner to the road, inside of
    which it is asked to be by as much."""
    path_m: float = 0.3
    """Accepted distance to the side of a path; of a prediction that is retimed, twice as
    much."""
    speed_mps: float = 0.3
    """Accepted deviation of speeds, and along a path in their time in m; agents are asked
    to stay below a speed limit by as much."""
    stop_m: float = 0.1
    """Accepted deviation from a stopping trajectory, in m and m/s, and from the gap to the
    agent ahead."""
    box_m: float = 0.05
    """Accepted deviation from what is not to be crossed: m from where boxes are apart, or
    meet; m/s2 from limits of accelerations, below which agents are asked to stay by twice
    as much."""
    led_weight: float = 0.1
    """Weight of avoiding collisions of agents that are led to a goal or along a path.
    Without it, they drive through agents that stand in the way."""
    max_swerve_m: float = 2.5
    """Agents swerve by no more to avoid a collision."""

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def goal_way_m(self) -> float:
        """Accepted deviation from a smooth way to a goal point."""
        return 10 * self.goal_m

    @property
    def pace_m(self) -> float:
        """Accepted deviation along a path, where only its course is asked for."""
        return 5 * self.path_m

    @property
    def threat_m(self) -> float:
        """Accepted deviation from the plan of a threat, before the meeting."""
        return 10 * self.box_m


_Value = TypeVar("_Value", bound=GuidanceTerm)


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualRows:
    """Residuals of G agents at T steps: weight * (direction . D^order(p) - target)."""

    agents: Int[Tensor, "G"]
    """Indices among the A agents of the motion; an agent may occur in several rows."""
    order: int
    """0: position, 1: velocity, 2: acceleration."""
    direction: Float[Tensor, "S G T 2"]
    """Unit vectors in the scene frame."""
    target: Float[Tensor, "S G T"]
    weight: Float[Tensor, "S G T"]
    """0 where there is no residual."""


@runtime_checkable
class TrajectoryTerm(Protocol):
    """A guidance term on the trajectories of one run."""

    @property
    def is_closed(self) -> bool:
        """Whether the result is projected to the term after the last step."""
        ...

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals at a prediction."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TermContext:
    """What terms of a run are made from: the scene's A agents and where they could go."""

    scenario: Scenario
    config: TermGuidance
    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    is_sampled: Bool[np.ndarray, "A"]
    is_standing: Bool[np.ndarray, "A"]
    """Whether an agent is stationary at the current step."""
    like: Tensor
    """A tensor of the motion's type, on its device."""
    duration_s: float

    def index_of(self, agent_id: str) -> int | None:
        """Index of an agent; None if it is not there at the current step."""
        return self.ids.index(agent_id) if agent_id in self.ids else None

    def guided(self, term: GuidanceTerm) -> Int[Tensor, "G"]:
        """Indices of the sampled agents that a term guides."""
        agent_ids, kinds = term.guided_ids, KINDS[term.kind].agents
        wanted = self.is_sampled & np.array(
            [
                one in agent_ids if agent_ids else kind in kinds
                for one, kind in zip(self.ids, self.kinds, strict=True)
            ],
            bool,
        )
        return torch.from_numpy(np.flatnonzero(wanted)).to(self.like.device)

    def planned(
        self, agents: Int[Tensor, "G"]
    ) -> tuple[Float[Tensor, "G P M 2"], Bool[Tensor, "G P"]]:
        """Paths that agents could take, one point every ``SPACING_M``."""
        scenario = self.scenario
        rows = scenario.agents.rows(self.ids[one] for one in agents.tolist())
        plans = current_paths(
            scenario.road_map,
            scenario.agents,
            scenario.current_step,
            tuple(rows.tolist()),
            self.duration_s,
        )
        order = np.argsort(plans.agent, kind="stable")
        agent = plans.agent[order]
        slot = np.arange(len(agent)) - np.searchsorted(agent, agent)
        most = int(slot.max(initial=0)) + 1
        points = np.zeros((len(agents), most, plans.paths.x_m.shape[1], 2))
        exists = np.zeros((len(agents), most), bool)
        points[agent, slot] = plans.paths.points_m[order]
        exists[agent, slot] = True
        return self.tensor(points), torch.from_numpy(exists).to(self.like.device)

    def tensor(self, values: np.ndarray) -> Float[Tensor, "..."]:
        """Values as a tensor of the motion's type, on its device."""
        return torch.as_tensor(values).to(self.like)


TermMaker = Callable[[Sequence[Any], TermContext], Sequence[TrajectoryTerm]]
"""Makes the terms of all values of a kind; none of agents that are not sampled."""
TermMakers = Mapping[type[GuidanceTerm], TermMaker]


def together(
    make: Callable[[Sequence[Any], TermContext], TrajectoryTerm | None],
) -> TermMaker:
    """Maker of one term of all values."""
    return lambda values, context: [one] if (one := make(values, context)) else []


def each(make: Callable[[Any, TermContext], TrajectoryTerm | None]) -> TermMaker:
    """Maker of one term of each value."""
    return lambda values, context: [
        one for value in values if (one := make(value, context))
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class GuidedAgents(Generic[_Value]):
    """The G sampled agents that values of one kind guide.

    An agent that is guided by two values occurs twice.
    """

    context: TermContext
    index: Int[Tensor, "G"]
    values: tuple[_Value, ...]
    """The value of each agent."""
    weight: Float[Tensor, "G 1"]
    _fields: dict[str, Tensor] = field(default_factory=dict, init=False)

    @classmethod
    def of(
        cls, values: Sequence[_Value], context: TermContext
    ) -> "GuidedAgents[_Value] | None":
        """Agents that values guide; None if no such agent is sampled."""
        pairs = [(one, context.guided(one)) for one in values]
        each = tuple(value for value, some in pairs for _ in range(len(some)))
        if not each:
            return None
        weight = np.array([value.weight for value in each])
        return cls(
            context=context,
            index=torch.cat([some for _, some in pairs]),
            values=each,
            weight=context.tensor(weight)[:, None],
        )

    @cached_property
    def planned(self) -> tuple[Float[Tensor, "G P M 2"], Bool[Tensor, "G P"]]:
        """Paths that the agents could take, one point every ``SPACING_M``."""
        return self.context.planned(self.index)

    def only(self, keep: Bool[np.ndarray, "G"]) -> "GuidedAgents[_Value]":
        """Some of the agents."""
        some = torch.from_numpy(np.flatnonzero(keep)).to(self.index.device)
        return replace(
            self,
            index=self.index[some],
            values=tuple(np.array(self.values, object)[keep]),
            weight=self.weight[some],
        )

    def of_each(self, name: str) -> Float[Tensor, "G *s"]:
        """A field of the value of each agent, numbers as [G 1]; read once."""
        if name not in self._fields:
            found = np.array([getattr(one, name) for one in self.values], float)
            found = found[:, None] if found.ndim == 1 else found
            self._fields[name] = self.context.tensor(found)
        return self._fields[name]


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentsTerm(ABC):
    """A term on each of some agents by itself."""

    guided: GuidedAgents
    is_closed: bool = True

    @classmethod
    def of(cls, values: Sequence[Any], context: TermContext) -> "AgentsTerm | None":
        """Make the term; None if no agent of it is sampled."""
        guided = GuidedAgents.of(values, context)
        return None if guided is None else cls.of_guided(guided)

    @classmethod
    def of_guided(cls, guided: GuidedAgents[Any]) -> "AgentsTerm | None":
        """Make the term of the agents that it guides; None if it has no effect."""
        return cls(guided=guided)

    @abstractmethod
    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals at a prediction."""

    @property
    def agents(self) -> Int[Tensor, "G"]:
        """Indices of the guided agents."""
        return self.guided.index

    @property
    def config(self) -> TermGuidance:
        """Accepted deviations and limits."""
        return self.guided.context.config


def row_weights(
    accepted: float,
    strength: float | Float[Tensor, "G 1"],
    like: Float[Tensor, "S G T"],
) -> Float[Tensor, "S G T"]:
    """Equal weights of rows at all steps.

    Args:
        accepted: accepted deviation, in the unit of the rows.
        strength: weight of the term, or of each agent.
        like: a tensor of the wanted shape.
    """
    # A trajectory has ten latents, so rows at all steps count as this many.
    share = 10.0 / like.shape[-1]
    weight = torch.as_tensor((strength * share) ** 0.5 / accepted)
    return weight.to(like).expand_as(like)
