"""Methods of an evaluation: reference methods and generators behind one interface."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

from pd_editor.analysis.metrics.traffic_view import TrafficView, generated_traffic
from pd_editor.base.errors import GenerationError
from pd_editor.base.foreign_code import is_reference
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.experiments.evaluation.reference_methods import (
    GROUND_TRUTH,
    REFERENCE_METHODS,
)
from pd_editor.scene.generation import (
    MAX_DENOISING_STEPS,
    MAX_TRIES,
    GenerationRequest,
    ScenarioGenerator,
    check_traffic,
    guidance_settings,
    run_to_end,
)

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
