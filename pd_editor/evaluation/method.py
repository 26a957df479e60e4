"""The port behind which everything that fills a scene is judged."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from pd_editor.errors import GenerationError
from pd_editor.evaluation.reference_methods import GROUND_TRUTH, REFERENCE_METHODS
from pd_editor.generation import (
    MAX_DENOISING_STEPS,
    MAX_TRIES,
    GeneratedTraffic,
    GenerationRequest,
    ScenarioGenerator,
    TrafficSample,
    guidance_terms,
    run_to_end,
)
from pd_editor.metrics.traffic_view import TrafficView, generated_traffic

_OPTIONS: Final = {"steps": MAX_DENOISING_STEPS, "lanes": 1, "tries": MAX_TRIES}
"""Options of a method, and the largest value of each."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A reference method, or a generator, by its name.

    A generator's name may carry options: ``path-diffuser:lanes=0.6,tries=4,steps=10``
    are the strength of the guidance to the lanes, the futures that are tried to avoid
    others, and the denoising steps.
    """

    name: str
    make_generator: Callable[[str], ScenarioGenerator]
    """Called with the name in the process that needs the generator."""

    @property
    def description(self) -> str:
        """One sentence for the report."""
        reference = REFERENCE_METHODS.get(self.name)
        if reference:
            return reference.description
        said = [f"{name} {value:g}" for name, value in self.options.items()]
        given = f", with {', '.join(said)}" if said else ""
        return f"Generator {self.generator_name!r}{given}."

    @property
    def generator_name(self) -> str:
        """The name without options."""
        return self.name.partition(":")[0]

    @property
    def options(self) -> Mapping[str, float]:
        """Options by name.

        Raises:
            GenerationError: they cannot be read.
        """
        found: dict[str, float] = {}
        for text in filter(None, self.name.partition(":")[2].split(",")):
            name, _, number = text.partition("=")
            try:
                found[name] = float(number)
            except ValueError:
                found[name] = math.nan
            least = 1 if name == "steps" else 0
            if name not in _OPTIONS or not least <= found[name] <= _OPTIONS[name]:
                raise GenerationError(
                    f"The method {self.name[:60]!r} has the option {text[:30]!r}; "
                    "expected steps, lanes or tries, such as lanes=0.6."
                )
        return found

    def traffic(self, request: GenerationRequest) -> "JudgedTraffic":
        """What is to be judged; references that draw nothing give one sample.

        Raises:
            GenerationError: a generator refused, or answered nonsense.
        """
        reference = REFERENCE_METHODS.get(self.name)
        if reference is not None:
            if request.samples_states and self.name != GROUND_TRUTH:
                raise GenerationError(f"{self.name} draws no states.")
            return JudgedTraffic(samples=reference.traffic(request))
        generator = _generator(self.make_generator, self.generator_name)
        traffic = run_to_end(generator.generate(self._with_options(request)))
        _check(traffic, request)
        return JudgedTraffic(
            samples=tuple(
                generated_traffic(request.scenario, sample)
                for sample in traffic.samples
            ),
            model_sha256=traffic.model_sha256,
        )

    def _with_options(self, request: GenerationRequest) -> GenerationRequest:
        options = self.options
        steps, tries = options.get("steps"), options.get("tries")
        return replace(
            request,
            num_denoising_steps=None if steps is None else int(steps),
            guidance=guidance_terms(
                options.get("lanes"), None if tries is None else int(tries)
            ),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedTraffic:
    """One view for each sample."""

    samples: tuple[TrafficView, ...]
    model_sha256: str = ""


@lru_cache(maxsize=4)
def _generator(
    make_generator: Callable[[str], ScenarioGenerator], name: str
) -> ScenarioGenerator:
    """Models are loaded once in each process."""
    return make_generator(name)


def _check(traffic: GeneratedTraffic, request: GenerationRequest) -> None:
    """Refuse an answer that is not what was asked for.

    Raises:
        GenerationError: samples, agents, shapes or numbers are wrong.
    """
    if len(traffic.samples) != request.num_samples:
        raise GenerationError(
            f"{len(traffic.samples)} samples came back, {request.num_samples} were "
            "asked for."
        )
    num_agents = len(request.agent_ids)
    num_steps = request.scenario.time_axis.num_future_steps + 1
    for number, sample in enumerate(traffic.samples):
        if sample.ids != request.agent_ids or len(sample.kinds) != num_agents:
            raise GenerationError(
                f"Sample {number} holds other agents than were asked for."
            )
        _check_arrays(sample, number, num_agents, num_steps)


def _check_arrays(
    sample: TrafficSample, number: int, num_agents: int, num_steps: int
) -> None:
    for name, expected in (
        ("size_m", (num_agents, 2)),
        ("position_m", (num_agents, num_steps, 2)),
        ("heading_rad", (num_agents, num_steps)),
        ("velocity_mps", (num_agents, num_steps, 2)),
    ):
        values = np.asarray(getattr(sample, name))
        if values.shape != expected:
            raise GenerationError(
                f"Sample {number}: {name} has the shape {values.shape}; expected "
                f"{expected}."
            )
        if not np.isfinite(values).all():
            raise GenerationError(f"Sample {number}: {name} holds NaN or infinity.")
