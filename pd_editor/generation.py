"""The port through which traffic is generated; plain values, NumPy only.

A generator is an iterator of progress that returns its result, so a caller shows
progress, and cancels, simply by iterating or not.
"""

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from pd_editor.errors import GenerationError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class GuidanceTerm:
    """One wish about the result: what, how strongly, for whom."""

    name: str
    weight: float = 1.0
    agent_ids: tuple[str, ...] = ()
    """Empty means all generated agents."""
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Region:
    """A square of the scene frame, along its axes."""

    center_m: tuple[float, float]
    half_side_m: float


@dataclass(frozen=True, kw_only=True)
class GenerationRequest:
    """What to generate, on which scenario."""

    scenario: Scenario
    agent_ids: tuple[str, ...]
    """Agents whose futures are redrawn; the rest is kept."""
    num_new_agents: Mapping[AgentKind, int] = field(default_factory=dict)
    """How many agents of each kind to add with states of the model's choosing."""
    draws_num_agents: bool = False
    """Whether the model also chooses how many of each kind, to suit the road."""
    redrawn_state_ids: tuple[str, ...] = ()
    """Those of ``agent_ids`` whose states are drawn anew too; id, kind, size stay."""
    moving_share: float | None = None
    """Of the agents of each kind whose states are drawn; None: as on roads alike."""
    only_on_road: bool = False
    """Whether states are drawn near lanes only, not on parking lots and the like."""
    region: Region | None = None
    """Where states are drawn. None: the model's own choice, around the traffic."""
    num_samples: int = 1
    num_denoising_steps: int | None = None
    """None: the generator's own default."""
    guidance: tuple[GuidanceTerm, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        share = self.moving_share
        if share is not None and not 0 <= share <= 1:
            raise GenerationError(
                f"The share of agents that move must be between 0 and 1, not {share:g}."
            )
        if (share is not None or self.only_on_road) and not self.draws_states:
            raise GenerationError(
                "Which share moves, and whether all are on the road, is about agents "
                "whose states are drawn: ask for new agents or for states drawn anew "
                "(in the shell --num-agents or --redraw-states)."
            )

    @property
    def draws_states(self) -> bool:
        """Whether anybody is placed, not only driven."""
        return bool(
            self.draws_num_agents
            or self.redrawn_state_ids
            or any(self.num_new_agents.values())
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficSample:
    """Generated states of G agents at S steps: the current one and all later ones."""

    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    size_m: Float[np.ndarray, "G 2"]
    position_m: Float[np.ndarray, "G S 2"]
    heading_rad: Float[np.ndarray, "G S"]
    velocity_mps: Float[np.ndarray, "G S 2"]

    def __post_init__(self) -> None:
        for name in ("position_m", "heading_rad", "velocity_mps"):
            if not np.isfinite(getattr(self, name)).all():
                raise GenerationError(f"The generated {name} holds NaN or infinity.")


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneratedTraffic:
    """A generator's answer."""

    samples: tuple[TrafficSample, ...]
    generator: str
    """Name of the generator or model."""
    model_sha256: str = ""
    """Hash of the weights; empty for rule-based generators."""
    seed: int = 0
    elapsed_s: float = 0.0
    notes: tuple[str, ...] = ()
    """What the user should know, such as agents that found no lane."""


@dataclass(frozen=True, kw_only=True)
class GenerationProgress:
    """A step done."""

    fraction: float
    message: str


@runtime_checkable
class ScenarioGenerator(Protocol):
    """Anything that can draw traffic for a scenario."""

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        ...

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress, return the traffic.

        Raises:
            GenerationError: the request cannot be met.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class GeneratorOffer:
    """A generator that users may choose; made, and loaded, when it is asked for."""

    make: Callable[[], ScenarioGenerator]
    draws_states: bool = False
    """Whether it can place agents, not only drive those that are there."""
    default_num_steps: int | None = None
    """Denoising steps; None if it takes no such number."""
    default_guidance: float | None = None
    """Weight of ``LANE_GUIDANCE``; None if it takes no guidance."""
    default_num_tries: int | None = None
    """Of ``AVOIDANCE``; None if it does not try several futures."""
    warm_up: Callable[[], None] | None = None
    """Loads what the first call would have to wait for; for a thread of its own."""


LANE_GUIDANCE: Final = "nearest-candidate"
"""Name of the term that pulls every agent to the nearest way along the lanes."""
AVOIDANCE: Final = "avoidance"
"""Name of the term by which, of ``tries`` futures of each agent, those that avoid
others are taken, and who would still run into somebody waits; ``tries`` is its
parameter. With none, futures stay as drawn."""


def guidance_terms(
    lane_weight: float | None, num_tries: int | None
) -> tuple[GuidanceTerm, ...]:
    """The usual terms; None leaves one to the generator."""
    terms: list[GuidanceTerm] = []
    if lane_weight is not None:
        terms.append(GuidanceTerm(name=LANE_GUIDANCE, weight=lane_weight))
    if num_tries is not None:
        tries = {"tries": float(num_tries)}
        terms.append(GuidanceTerm(name=AVOIDANCE, parameters=tries))
    return tuple(terms)


def run_to_end(
    steps: Generator[GenerationProgress, None, GeneratedTraffic],
) -> GeneratedTraffic:
    """The result of a generation whose progress nobody watches."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value
