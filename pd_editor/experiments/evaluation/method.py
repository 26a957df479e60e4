"""Methods of an evaluation behind one interface, and their trials on scenes."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.metrics.traffic_view import (
    TrafficView,
    generated_traffic,
    recorded_traffic,
)
from pd_editor.base.errors import GenerationError
from pd_editor.base.foreign_code import is_reference
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.experiments.evaluation.evaluation_task import RoadCondition
from pd_editor.experiments.work_engine.work_engine import failure_of, time_limit
from pd_editor.scene.base_reference import SceneCut, part_name
from pd_editor.scene.generation import (
    MAX_DENOISING_STEPS,
    MAX_TRIES,
    GenerationRequest,
    ScenarioGenerator,
    TrafficSample,
    check_traffic,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.paths.motion_primitives import CandidateSet, candidates
from pd_editor.scene.scene_cut import COMPARED

GROUND_TRUTH: Final = "ground-truth"
"""Name of the method that all others are compared with."""
_FAR_M: Final = 1e9


@dataclass(frozen=True, kw_only=True)
class ReferenceMethod:
    """A method without a generator."""

    name: str
    description: str
    traffic: Callable[[GenerationRequest], tuple[TrafficView, ...]]
    """Function that makes one view per sample; deterministic methods give one view."""


def _ground_truth(request: GenerationRequest) -> tuple[TrafficView, ...]:
    return (recorded_traffic(request.scenario, request.agent_ids),)


def _constant_velocity(request: GenerationRequest) -> tuple[TrafficView, ...]:
    agents, axis = request.scenario.agents, request.scenario.time_axis
    rows, step = agents.rows(request.agent_ids), axis.current_step
    time = axis.times_s()[step:, None]
    velocity = np.repeat(agents.velocity_mps[rows, step, None], len(time), axis=1)
    position = agents.position_m[rows, step, None] + time * velocity
    heading = np.repeat(agents.heading_rad[rows, step, None], len(time), axis=1)
    return (_view(request, position, heading, velocity),)


def _random_candidate(request: GenerationRequest) -> tuple[TrafficView, ...]:
    scenario = request.scenario
    rows = scenario.agents.rows(request.agent_ids)
    found = candidates(scenario, rows)
    count = found.is_valid.sum(axis=1)
    views = []
    for sample in range(request.num_samples):
        random = np.random.default_rng([request.scene_seed, sample])
        # Sampled for all agents, so that it does not depend on the requested agents.
        pick = random.random(len(scenario.agents))[rows]
        views.append(_chosen(request, found, (pick * count).astype(int)))
    return tuple(views)


def _best_candidate(request: GenerationRequest) -> tuple[TrafficView, ...]:
    scenario = request.scenario
    rows = scenario.agents.rows(request.agent_ids)
    found = candidates(scenario, rows)
    later = slice(scenario.current_step + 1, None)
    logged = scenario.agents.position_m[rows, later]
    is_known = scenario.agents.is_valid[rows, later]
    offset = found.position_m[:, :, 1:] - logged[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    mean = np.where(is_known[:, None], distance, 0.0).sum(axis=2)
    mean = np.where(found.is_valid, mean, _FAR_M)
    return (_chosen(request, found, mean.argmin(axis=1)),)


def _chosen(
    request: GenerationRequest, found: CandidateSet, choice: Int[np.ndarray, "A"]
) -> TrafficView:
    agent = np.arange(len(choice))
    return _view(
        request,
        found.position_m[agent, choice],
        found.heading_rad[agent, choice],
        found.velocity_mps[agent, choice],
    )


def _view(
    request: GenerationRequest,
    position_m: Float[np.ndarray, "A H 2"],
    heading_rad: Float[np.ndarray, "A H"],
    velocity_mps: Float[np.ndarray, "A H 2"],
) -> TrafficView:
    agents = request.scenario.agents
    motion = (position_m, heading_rad, velocity_mps)
    sample = TrafficSample.of(agents.taken(agents.rows(request.agent_ids)), motion)
    return generated_traffic(request.scenario, sample)


_ALL: Final = (
    ReferenceMethod(
        name=GROUND_TRUTH,
        description="The log. An agent counts while it is recorded.",
        traffic=_ground_truth,
    ),
    ReferenceMethod(
        name="constant-velocity",
        description="Every agent keeps its velocity.",
        traffic=_constant_velocity,
    ),
    ReferenceMethod(
        name="random-candidate",
        description="Every agent takes one of its Frenet candidates, sampled at random.",
        traffic=_random_candidate,
    ),
    ReferenceMethod(
        name="best-candidate",
        description="ORACLE: every agent takes the candidate nearest to its logged "
        "future, which no generator knows.",
        traffic=_best_candidate,
    ),
)
REFERENCE_METHODS: Final[Mapping[str, ReferenceMethod]] = {
    method.name: method for method in _ALL
}


_OPTIONS: Final = {
    "steps": MAX_DENOISING_STEPS,
    "lanes": 1,
    "tries": MAX_TRIES,
    "raw": 1,
}
"""Options of a method, and the largest value of each."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A reference method or a generator, given by name.

    A generator's name may have options: ``path-diffuser:lanes=0.6,tries=4,steps=10``
    sets the strength of lane guidance, the number of trajectories sampled per agent, and
    the denoising steps. ``raw=1`` is what the networks sample, without guidance, repair
    and yielding.
    """

    name: str
    make_generator: Callable[[str], ScenarioGenerator]
    """Factory of the generator, called in the process that uses it."""

    @property
    def description(self) -> str:
        """Description for the report, one sentence."""
        reference = REFERENCE_METHODS.get(self.name)
        if reference:
            return reference.description
        settings = [f"{name} {value:g}" for name, value in self.options.items()]
        given = f", with {', '.join(settings)}" if settings else ""
        return f"Generator {self.generator_name!r}{given}."

    @property
    def generator_name(self) -> str:
        """The name without options."""
        return self._parts[0]

    @property
    def _parts(self) -> tuple[str, str]:
        """Name and options; ``package.module:attribute`` has a colon of its own."""
        name, _, options = self.name.rpartition(":")
        if is_reference(self.name) and options not in _OPTIONS:
            return self.name, ""
        if is_reference(name):
            return name, options
        name, _, options = self.name.partition(":")
        return name, options

    @property
    def options(self) -> Mapping[str, float]:
        """Options by name.

        Raises:
            GenerationError: the options are not valid.
        """
        found: dict[str, float] = {}
        for text in filter(None, self._parts[1].split(",")):
            name, _, number = text.partition("=")
            try:
                found[name] = float(number)
            except ValueError:
                found[name] = math.nan
            least = 1 if name == "steps" else 0
            if name not in _OPTIONS:
                raise GenerationError(
                    f"The method {self.name[:60]!r} has the option {text[:30]!r}; "
                    f"{nearest_or_all(name, _OPTIONS)}, such as lanes=0.6."
                )
            if not least <= found[name] <= _OPTIONS[name]:
                raise GenerationError(
                    f"The method {self.name[:60]!r} has the option {text[:30]!r}; "
                    f"expected a number from {least} to {_OPTIONS[name]}."
                )
        return found

    def traffic(self, request: GenerationRequest) -> "EvaluatedTraffic":
        """Traffic to evaluate; deterministic references give one sample.

        Raises:
            GenerationError: a generator refused, or its result is invalid.
        """
        reference = REFERENCE_METHODS.get(self.name)
        if reference is not None:
            if request.samples_states and self.name != GROUND_TRUTH:
                raise GenerationError(f"{self.name} samples no initial states.")
            return EvaluatedTraffic(samples=reference.traffic(request))
        generator = _generator(self.make_generator, self.generator_name)
        traffic = run_to_end(generator.generate(self.with_options(request)))
        check_traffic(traffic, request)
        return EvaluatedTraffic(
            samples=tuple(
                generated_traffic(request.scenario, sample)
                for sample in traffic.samples
            ),
            model_sha256=traffic.model_sha256,
        )

    def with_options(self, request: GenerationRequest) -> GenerationRequest:
        """The request with the options of the name."""
        options = self.options
        is_raw = bool(options.get("raw", 0))
        usual = {"lanes": 0.0, "tries": 0.0} if is_raw else {}
        steps, tries = options.get("steps"), options.get("tries", usual.get("tries"))
        return replace(
            request,
            num_denoising_steps=None if steps is None else int(steps),
            refines_states=not is_raw,
            guidance=guidance_settings(
                options.get("lanes", usual.get("lanes")),
                None if tries is None else int(tries),
            ),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluatedTraffic:
    """Views of a method's traffic, one per sample."""

    samples: tuple[TrafficView, ...]
    model_sha256: str = ""


@lru_cache(maxsize=32)
def _generator(
    make_generator: Callable[[str], ScenarioGenerator], name: str
) -> ScenarioGenerator:
    """Make a generator; models are loaded once per process."""
    return make_generator(name)


def forget_generators() -> None:
    """Release the generators that this process has made."""
    _generator.cache_clear()


_Value = TypeVar("_Value")


@dataclass(frozen=True, kw_only=True)
class TrialPlan:
    """Scenes, methods and roads of many trials."""

    data: tuple[Path, ...]
    """Roots of datasets; folders below them are searched."""
    methods: tuple[Method, ...]
    conditions: tuple[RoadCondition, ...]
    num_samples: int = 1
    limit: int | None = None
    """Limit of scenes, the first ones by their folders' names."""
    limit_s: float | None = None
    """Time that a method may take for a trial; a method that takes longer fails there."""
    cut: SceneCut = COMPARED
    """What is used of each recording."""
    map_parts: tuple[str, ...] = ()
    """Which parts of maps the scenes are, in words of the shell."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that finished trials depend on."""
        return {
            # With another version, definitions may change.
            "version": version("pd-editor"),
            "data": [os.path.realpath(root) for root in self.data],
            "methods": [method.name for method in self.methods],
            "samples": self.num_samples,
            "current_s": self.cut.current_s,
            "map_parts": self.map_parts,
        }


@dataclass(frozen=True, kw_only=True)
class TrialItem:
    """Work item on one scene."""

    folder: Path
    split: str
    """Name of the scene's split."""
    num_samples: int
    seed: int
    limit_s: float | None = None
    """Time that a method may take; None: as long as it takes."""
    cut: SceneCut = COMPARED
    """What is used of the recording."""

    @property
    def place(self) -> Path:
        """Its folder, with a name that tells which part of its map is used."""
        return self.folder.with_name(part_name(self.folder.name, self.cut.window))


def tried(make: Callable[[], _Value], limit_s: float | None) -> _Value | str:
    """What a method makes, or the reason why it made nothing in time."""
    try:
        with time_limit(limit_s):
            return make()
    except Exception as error:  # noqa: BLE001  (methods may raise any error)
        return failure_of(error).reason
