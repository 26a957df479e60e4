"""Interface of traffic generators: requests, results and progress (NumPy only).

``generate`` is a Python generator: it yields progress and returns the result, so that a
caller can show progress and cancel.
"""

import hashlib
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, TypeVar, get_args, runtime_checkable

import numpy as np
import shapely

from pd_editor.base.errors import GenerationError
from pd_editor.base.plain_text import is_plain, nearest_or_all
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.guidance_terms import (
    MAX_TERMS,
    GuidanceCost,
    GuidanceTerm,
    TermOutcome,
)
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_AGENTS, MAX_POSITION_M
from pd_editor.scene.thresholds import SAME_STATE_M
from pd_editor.scene.traffic_sample import TrafficSample

MAX_SAMPLES: Final = 1_000
MAX_DENOISING_STEPS: Final = 1_000
MAX_TRIES: Final = 64
MAX_TRAJECTORIES: Final = 50_000
"""Limit of samples times tries times agents in one request."""
MAX_SEED: Final = 2**63 - 1


Made = TypeVar("Made")
"""What steps return at their end."""
Quality = Literal["fast", "high"]
"""Quality of sampled states; higher quality takes more time."""
Capability = Literal["states", "new-agents", "guidance"]
"""What a generator may be able to do beside trajectories of agents as they are: resample
their initial states, add agents, and obey guidance terms."""
CAPABILITIES: Final[frozenset[Capability]] = frozenset(get_args(Capability))


@dataclass(frozen=True, kw_only=True)
class GuidanceSetting:
    """A setting of the generator's own guidance: name, strength, agents it applies to."""

    name: str
    weight: float = 1.0
    agent_ids: tuple[str, ...] = ()
    """Empty means all generated agents."""
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not is_plain(self.name):
            raise GenerationError(f"{self.name!r} cannot be the name of a guidance.")
        values = {"weight": self.weight, **self.parameters}
        for name, value in values.items():
            if not math.isfinite(value):
                raise GenerationError(
                    f"The {name} of the guidance {self.name} is {value:g}; expected a "
                    "finite number."
                )
        tries = self.parameters.get("tries", 0)
        if self.name == AVOIDANCE and not (
            0 <= tries <= MAX_TRIES and tries == int(tries)
        ):
            raise GenerationError(
                f"The number of tries is {tries:g}; expected a whole number from 0 to "
                f"{MAX_TRIES}."
            )


@dataclass(frozen=True, kw_only=True)
class Region:
    """An axis-aligned square of the scene frame."""

    center_m: tuple[float, float]
    half_side_m: float

    def __post_init__(self) -> None:
        if not 0 < self.half_side_m <= MAX_POSITION_M:
            raise GenerationError(
                f"Half the side of the region is {self.half_side_m:g} m; expected more "
                f"than 0 and at most {MAX_POSITION_M:g} m."
            )
        if not all(abs(value) <= MAX_POSITION_M for value in self.center_m):
            raise GenerationError(
                f"The region's centre ({self.center_m[0]:g}, {self.center_m[1]:g}) m "
                f"is more than {MAX_POSITION_M:g} m from the scene's origin."
            )

    def has_road(self, road_map: RoadMap) -> bool:
        """Whether a lane for vehicles is in it."""
        (x, y), half = self.center_m, self.half_side_m
        square = shapely.box(x - half, y - half, x + half, y + half)
        return any(
            shapely.intersects(square, shapely.LineString(lane.centerline[:, :2]))
            for lane in road_map.lanes
            if lane.kind is not LaneKind.BIKE
        )

    def held(self, scenario: Scenario, agent_ids: Sequence[str]) -> tuple[str, ...]:
        """Those agents that are in it at the current step."""
        agents, step = scenario.agents, scenario.current_step
        rows = agents.rows(agent_ids)
        offset = np.abs(agents.position_m[rows, step] - np.array(self.center_m))
        is_inside = (offset <= self.half_side_m).all(axis=1)
        is_inside &= agents.is_valid[rows, step]
        return tuple(agents.ids[row] for row in rows[is_inside])


def check_room(request: "GenerationRequest", num_removed: int) -> None:
    """Refuse a request that would only remove agents, because nothing fits there.

    Raises:
        GenerationError: as many as fit are asked for where there is no road.
    """
    region = request.region
    if region is None or not (request.samples_num_agents and num_removed):
        return
    if not region.has_road(request.scenario.road_map):
        raise GenerationError(
            f"There is no mapped road in this region: {_would_go(num_removed)}."
        )


def check_placed(traffic: "GeneratedTraffic", num_removed: int) -> None:
    """Refuse a result that would only remove agents.

    Raises:
        GenerationError: no sample has any agent.
    """
    if num_removed and not any(sample.ids for sample in traffic.samples):
        raise GenerationError(
            "No agent was placed: there are as many road users as suit the road, so "
            f"{_would_go(num_removed)}."
        )


def _would_go(number: int) -> str:
    agents = "1 agent" if number == 1 else f"{number} agents"
    return f"{agents} would only be removed"


def scene_seed(seed: int, scenario_id: str) -> int:
    """Seed of the random numbers of one scenario.

    With equal numbers, scenarios are alike: one seed made 75 % of the vehicles of 35
    scenes stand, another one 53 %. An edited scenario keeps its id and so its numbers.
    """
    digest = hashlib.sha256(f"{seed}/{scenario_id}".encode()).digest()
    return int.from_bytes(digest[:4])


@dataclass(frozen=True, kw_only=True)
class NoiseDrift:
    """Noise that changes slowly from request to request, agent by agent.

    In a roll-out, fresh noise would make each agent another driver each time, and equal
    noise would let one that brakes brake for ever.
    """

    ids: tuple[str, ...]
    """All agents that have ever been there, in a lasting order."""
    place: float
    """Time in units after which the noise is independent of what it was; at least 0."""


@dataclass(frozen=True, kw_only=True)
class GenerationRequest:
    """Request for traffic on a scenario."""

    scenario: Scenario
    agent_ids: tuple[str, ...]
    """Agents whose trajectories are generated; all others are context."""
    num_new_agents: Mapping[AgentKind, int] = field(default_factory=dict)
    """Number of agents of each kind to add with sampled initial states."""
    samples_num_agents: bool = False
    """Whether the model also samples the number of agents of each kind for the road."""
    resampled_state_ids: tuple[str, ...] = ()
    """Those of ``agent_ids`` whose initial states are resampled; id, kind, size stay."""
    moving_share: float | None = None
    """Fraction of the sampled agents of each kind that moves; None: unconditioned."""
    admits: Callable[[Scenario, Sequence[str]], Sequence[str]] | None = None
    """Which of the new agents may stay, given the scene with their states. With it, those
    that break a rule of placement are left out, too, rather than placed again."""
    only_on_road: bool = False
    """Whether states are sampled near lanes only, not for example on parking lots."""
    region: Region | None = None
    """Square in which states are sampled. None: around agents, and on the mapped road
    around the focal agent."""
    quality: Quality = "fast"
    """Quality of sampled states: "high" takes more denoising steps."""
    refines_states: bool = True
    """Whether sampled states are guided and repaired; if not, they are raw output."""
    back_casts: bool = True
    """Whether agents with sampled states get a made-up past."""
    num_samples: int = 1
    num_denoising_steps: int | None = None
    """Denoising steps of trajectories; None: the generator's default."""
    guidance: tuple[GuidanceTerm | GuidanceSetting, ...] = ()
    """Terms of this run, in addition to those of the scenario, and settings."""
    reports_cost: bool = True
    """Whether an unguided sample is made to compare with, if there are terms. Takes about
    as long again as the sample itself."""
    seed: int = 0
    """Seed of the user; generators make their random numbers from ``scene_seed``."""
    drift: NoiseDrift | None = None
    """Where in a roll-out the request stands; only for the noise of trajectories."""
    before_edit: Scenario | None = None
    """Scenario before an edit that agents react to: their trajectories there are deformed
    where the edit concerns them. None: trajectories are sampled from random noise only."""

    def __post_init__(self) -> None:
        check_future(self.scenario)
        check_numbers(
            num_samples=self.num_samples,
            num_denoising_steps=self.num_denoising_steps,
            num_new_agents=self.num_new_agents,
            seed=self.seed,
        )
        if len(self.scenario.guidance) + len(self.guidance) > MAX_TERMS:
            raise GenerationError(
                f"{len(self.scenario.guidance) + len(self.guidance)} guidance terms were "
                f"requested; at most {MAX_TERMS} are possible."
            )
        tries = max(
            (one.parameters.get("tries", 1) for one in self.settings), default=1.0
        )
        num_agents = len(self.agent_ids) + sum(self.num_new_agents.values())
        num_trajectories = int(self.num_samples * max(tries, 1) * num_agents)
        if num_trajectories > MAX_TRAJECTORIES:
            raise GenerationError(
                f"{num_trajectories} trajectories were requested (samples times tries times "
                f"agents); at most {MAX_TRAJECTORIES} are sampled at once."
            )
        share = self.moving_share
        if share is not None and not 0 <= share <= 1:
            raise GenerationError(
                f"The share of agents that move must be between 0 and 1, not {share:g}."
            )
        if (share is not None or self.only_on_road) and not self.samples_states:
            raise GenerationError(
                "Which share moves, and whether all are on the road, is about agents "
                "whose states are sampled: ask for new agents or for resampled states "
                "(in the shell --num-agents or --resample-states)."
            )
        self._check_locks()

    def _check_locks(self) -> None:
        locks = self.scenario.locks
        for name in self.agent_ids:
            if name in locks and locks[name].keeps == "trajectory":
                raise GenerationError(
                    f"The trajectory of agent {name} is locked, so it cannot be "
                    "generated; unlock the agent or leave it out."
                )
        for name in self.resampled_state_ids:
            if name in locks:
                raise GenerationError(
                    f"The state of agent {name} is locked, so it cannot be resampled; "
                    "unlock the agent or leave it out."
                )

    @property
    def scene_seed(self) -> int:
        """Seed of the random numbers of this scenario: see ``scene_seed``."""
        return scene_seed(self.seed, self.scenario.scenario_id)

    @property
    def settings(self) -> tuple[GuidanceSetting, ...]:
        """Settings of the generator's own guidance."""
        return tuple(one for one in self.guidance if isinstance(one, GuidanceSetting))

    def setting(self, name: str) -> GuidanceSetting | None:
        """The last setting of a name; None if there is none."""
        return next((one for one in self.settings[::-1] if one.name == name), None)

    @property
    def terms(self) -> tuple[GuidanceTerm, ...]:
        """Guidance terms in force: those of the scenario, then those of this run."""
        own = (one for one in self.guidance if not isinstance(one, GuidanceSetting))
        return tuple(one for one in (*self.scenario.guidance, *own) if one.is_on)

    @property
    def adds_agents(self) -> bool:
        """Whether agents are added."""
        return self.samples_num_agents or any(self.num_new_agents.values())

    @property
    def samples_states(self) -> bool:
        """Whether initial states of any agents are sampled."""
        return self.adds_agents or bool(self.resampled_state_ids)


@dataclass(frozen=True, kw_only=True, eq=False)
class GuidanceReport:
    """How one sample meets the guidance terms, and what that costs."""

    outcomes: tuple[TermOutcome, ...] = ()
    """One per term in force."""
    cost: GuidanceCost | None = None
    """None if no unguided sample was made to compare with."""
    unguided: TrafficSample | None = None
    """The unguided sample of the same seed, if guidance made the scene worse than a
    bound: for the user to take instead."""
    motion_problems: tuple[str, ...] = ()
    """Sentences on agents whose accelerations or curvatures are impossible, or that
    reverse."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneratedTraffic:
    """Result of a generator."""

    samples: tuple[TrafficSample, ...]
    generator: str
    """Name of the generator or model."""
    model_sha256: str = ""
    """Hash of the weights; empty for rule-based generators."""
    seed: int = 0
    elapsed_s: float = 0.0
    notes: tuple[str, ...] = ()
    """Remarks for the user, such as agents that found no lane."""
    measures: tuple[str, ...] = ()
    """What was measured of it, in sentences; nothing that a user must know."""
    slowed_ids: tuple[tuple[str, ...], ...] = ()
    """Ids of the agents of each sample that were slowed to avoid a collision; empty if
    there are none in any sample."""
    guidance: tuple[GuidanceReport, ...] = ()
    """One report per sample; empty without guidance terms."""


@dataclass(frozen=True, kw_only=True)
class GenerationProgress:
    """Progress of a generation after a step."""

    fraction: float
    message: str


@runtime_checkable
class ScenarioGenerator(Protocol):
    """Interface of everything that generates traffic for a scenario.

    An optional attribute ``supports`` names what it can do beside trajectories: see
    ``Capability``. Without it, it can do nothing of that.
    """

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        ...

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress and return the traffic.

        Raises:
            GenerationError: the request cannot be met.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class GeneratorSpec:
    """Specification of a generator that users can choose; built and loaded on demand."""

    make: Callable[[], ScenarioGenerator]
    origin: str = ""
    """Where it is from, in words for the user."""
    supports: frozenset[Capability] = frozenset()
    """What it can do beside trajectories of existing agents."""
    default_num_steps: int | None = None
    """Default number of denoising steps; None if it has none."""
    default_guidance: float | None = None
    """Default weight of ``LANE_GUIDANCE``; None if it has no guidance."""
    default_num_tries: int | None = None
    """Default tries of ``AVOIDANCE``; None if it does not select among several samples."""
    warm_up: Callable[[], None] | None = None
    """Loads the model ahead of the first call; to be run in a separate thread."""


LANE_GUIDANCE: Final = "nearest-candidate"
"""Name of the setting that pulls each agent to its nearest Frenet candidate."""
AVOIDANCE: Final = "avoidance"
"""Name of the setting that avoids collisions: of ``tries`` sampled trajectories per agent,
the least colliding joint combination is selected, and agents that would still collide
yield, unless its parameter ``yields`` is 0. Without tries no collision is avoided."""


def supported_by(generator: ScenarioGenerator) -> frozenset[Capability]:
    """What a generator declares by its attribute ``supports``.

    Raises:
        GenerationError: it declares something unknown.
    """
    declared = getattr(generator, "supports", ())
    names = (declared,) if isinstance(declared, str) else tuple(declared)
    for name in names:
        if name not in CAPABILITIES:
            raise GenerationError(
                f"The generator {generator.name} supports {name!r}, which is unknown; "
                f"{nearest_or_all(str(name), sorted(CAPABILITIES))}."
            )
    return frozenset(one for one in CAPABILITIES if one in names)


def check_supported(
    request: GenerationRequest, supports: frozenset[Capability], name: str
) -> None:
    """Refuse a request for sampled states that a generator cannot meet.

    Raises:
        GenerationError: names the generator and what it cannot do.
    """
    if request.adds_agents and "new-agents" not in supports:
        raise GenerationError(
            f"The generator {name} adds no agents; keep those of the scene, or choose a "
            "generator that does."
        )
    if request.resampled_state_ids and "states" not in supports:
        raise GenerationError(
            f"The generator {name} samples no initial states; keep the states, or choose "
            "a generator that does."
        )


def check_numbers(
    *,
    num_samples: int,
    num_denoising_steps: int | None,
    num_new_agents: Mapping[AgentKind, int],
    seed: int,
) -> None:
    """Raise for numbers of a request that are out of range.

    Raises:
        GenerationError: names the range.
    """
    steps = 1 if num_denoising_steps is None else num_denoising_steps
    counts = [*num_new_agents.values(), sum(num_new_agents.values())]
    for what, value, least, most in (
        ("samples", num_samples, 1, MAX_SAMPLES),
        ("denoising steps", steps, 1, MAX_DENOISING_STEPS),
        *(("new agents", count, 0, MAX_AGENTS) for count in counts),
    ):
        if not least <= value <= most:
            raise GenerationError(
                f"The number of {what} is {value}; expected {least} to {most}."
            )
    if not 0 <= seed <= MAX_SEED:
        raise GenerationError(f"The seed is {seed}; expected 0 to {MAX_SEED}.")


def guidance_settings(
    lane_weight: float | None, num_tries: int | None, *, yields: bool = True
) -> tuple[GuidanceSetting, ...]:
    """Settings for lanes and avoidance; None leaves a value to the generator."""
    settings: list[GuidanceSetting] = []
    if lane_weight is not None:
        settings.append(GuidanceSetting(name=LANE_GUIDANCE, weight=lane_weight))
    parameters = {} if num_tries is None else {"tries": float(num_tries)}
    if not yields:
        parameters["yields"] = 0.0
    if parameters:
        settings.append(GuidanceSetting(name=AVOIDANCE, parameters=parameters))
    return tuple(settings)


def check_future(scenario: Scenario) -> None:
    """Raise for a scenario that has no step to generate.

    Raises:
        GenerationError: the current step is the last one.
    """
    axis = scenario.time_axis
    if not axis.num_future_steps:
        raise GenerationError(
            f"The scenario ends at its current step ({axis.current_step}, of steps 0 to"
            f" {axis.num_steps - 1}), so there is no future to generate; expected steps"
            " after it."
        )


def check_traffic(traffic: GeneratedTraffic, request: GenerationRequest) -> None:
    """Refuse an answer that is not what was asked for.

    Raises:
        GenerationError: samples, agents, shapes or numbers are wrong.
    """
    if len(traffic.samples) != request.num_samples:
        raise GenerationError(
            f"{len(traffic.samples)} samples came back, {request.num_samples} were "
            "asked for."
        )
    num_steps = request.scenario.time_axis.num_future_steps + 1
    for number, sample in enumerate(traffic.samples):
        kept = (
            sample.ids[: len(request.agent_ids)] if request.adds_agents else sample.ids
        )
        if kept != request.agent_ids or len(sample.kinds) != len(sample.ids):
            raise GenerationError(
                f"Sample {number} holds other agents than were asked for."
            )
        sample.check(num_steps, f"Sample {number}:")
        _check_current(sample, number, request)
        check_kept(sample, request)


def _check_current(
    sample: TrafficSample, number: int, request: GenerationRequest
) -> None:
    """Refuse a sample that moves an agent whose state was not to be sampled."""
    agents, now = request.scenario.agents, request.scenario.current_step
    rows = agents.rows(request.agent_ids)
    gap = sample.position_m[: len(rows), 0] - agents.position_m[rows, now]
    distance = np.hypot(gap[:, 0], gap[:, 1])
    for name, moved_m in zip(request.agent_ids, distance.tolist(), strict=True):
        if moved_m > SAME_STATE_M and name not in request.resampled_state_ids:
            raise GenerationError(
                f"Sample {number} moves agent {name} by {moved_m:.2f} m at the current "
                "step; expected its state as it is, since none was to be sampled."
            )


def check_kept(sample: TrafficSample, request: GenerationRequest) -> None:
    """Refuse a sample in which something that a lock keeps is different.

    Raises:
        GenerationError: names the agent.
    """
    scenario = request.scenario
    ids = [name for name in request.agent_ids if name in scenario.locks]
    if not ids:
        return
    now = scenario.current_step
    rows = scenario.agents.rows(ids)
    found = [sample.ids.index(name) for name in ids]
    is_kept = scenario.kept_steps()[rows, now:] & scenario.agents.is_valid[rows, now:]
    gap = sample.position_m[found] - scenario.agents.position_m[rows, now:]
    is_off = (np.hypot(gap[..., 0], gap[..., 1]) > SAME_STATE_M) & is_kept
    for name, is_moved in zip(ids, np.any(is_off, axis=1).tolist(), strict=True):
        if is_moved:
            raise GenerationError(
                f"The {scenario.locks[name].in_words} of agent {name} is locked, and the "
                "generator did not keep it; lock the whole trajectory, or use a "
                "generator that takes locks."
            )


def run_to_end(
    steps: Generator[GenerationProgress, None, Made],
    on_progress: Callable[[GenerationProgress], None] = lambda _: None,
) -> Made:
    """Run a generation and return its result."""
    while True:
        try:
            progress = next(steps)
        except StopIteration as stop:
            return stop.value
        on_progress(progress)
