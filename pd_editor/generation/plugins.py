"""Generators and predictors of one's own: from modules, entry points and folders.

A name of three forms is taken: ``package.module:attribute``, a name of the entry-point
group ``pd_editor.generators``, and a folder with ``generator.py``, which defines
``make_generator(folder)``. What is found is a generator, a predictor, or a class or
function that makes one without arguments.
"""

import importlib.util
import operator
import os
import sys
import time
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.report import guidance_reports
from pd_editor.base.errors import GenerationError
from pd_editor.base.foreign_code import asked, object_of_reference
from pd_editor.base.plain_text import MAX_ID_CHARACTERS, is_plain, one_line
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.generation import (
    Capability,
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    ScenarioGenerator,
    check_supported,
    check_traffic,
    supported_by,
)
from pd_editor.scene.prediction import (
    AgentHistory,
    Predictor,
    checked_prediction,
    prediction_request,
)
from pd_editor.scene.traffic_sample import TrafficSample


class PredictorGenerator:
    """Sample s takes the trajectory of each agent that is the s-th most probable.

    Where a predictor gives fewer trajectories than samples are asked for, it begins
    again with the most probable one. It samples no initial states.
    """

    def __init__(self, predictor: Predictor) -> None:
        """Wrap a predictor."""
        self._predictor = predictor

    @property
    def name(self) -> str:
        """The predictor's own name."""
        return self._predictor.name

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress, return the traffic.

        Raises:
            GenerationError: there is nothing to predict, or the prediction is wrong.
            EditError: an agent is not in the scenario.
        """
        began = time.perf_counter()
        scenario = request.scenario
        asked = prediction_request(
            scenario,
            request.agent_ids,
            num_modes=request.num_samples,
            seed=request.scene_seed,
        )
        if not asked.num_steps:
            raise GenerationError(
                f"Scenario {asked.scenario_id} has no steps after the current one to "
                "predict."
            )
        yield GenerationProgress(fraction=0.0, message="Predicting")
        found = checked_prediction(self._predictor.predict(asked), asked, self.name)
        order = np.argsort(-found.probability, axis=1, kind="stable")
        rows, num_modes = np.arange(len(order)), order.shape[1]
        return GeneratedTraffic(
            samples=tuple(
                _sample(
                    asked.agents,
                    found.position_m[rows, order[:, number % num_modes]],
                    asked.step_s,
                )
                for number in range(request.num_samples)
            ),
            generator=self.name,
            seed=request.seed,
            elapsed_s=time.perf_counter() - began,
        )


def _sample(
    agents: AgentHistory, later_m: Float[np.ndarray, "A F 2"], step_s: float
) -> TrafficSample:
    """Trajectories with headings and velocities, the current state first."""
    now_m, now_mps = agents.position_m[:, -1:], agents.velocity_mps[:, -1:]
    position = np.concatenate([now_m, later_m], axis=1)
    step = np.diff(position, axis=1)
    heading = np.concatenate(
        [agents.heading_rad[:, -1:], np.arctan2(step[..., 1], step[..., 0])], axis=1
    )
    # An agent that moves less in a step keeps its heading.
    moves = np.hypot(step[..., 0], step[..., 1]) >= 0.02
    turns = np.concatenate([np.ones((len(step), 1), bool), moves], axis=1)
    last = np.maximum.accumulate(np.where(turns, np.arange(turns.shape[1]), 0), axis=1)
    heading = np.take_along_axis(heading, last, axis=1)
    velocity = np.concatenate([now_mps, step / step_s], axis=1)
    return TrafficSample.of(agents, (position, heading, velocity))


ENTRY_POINTS: Final = "pd_editor.generators"
FOLDER_MODULE: Final = "generator.py"


class _Checked:
    """A plugin whose faults, and wrong answers, become one sentence for the user."""

    def __init__(self, generator: ScenarioGenerator, place: str) -> None:
        self._generator, self._place = generator, place
        self.name: str = asked(
            lambda: checked_name(generator.name), place, " has no usable name"
        )
        """The plugin's own name."""
        self.supports: frozenset[Capability] = asked(
            lambda: supported_by(generator), place, " did not say what it supports"
        )

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield the plugin's progress, return its traffic.

        Raises:
            GenerationError: the plugin does not support the request, raised something,
                or its answer does not fit.
        """
        check_supported(request, self.supports, self.name)
        answer: Any = self._asked(lambda: self._generator.generate(request))
        # A plugin without progress may return the traffic at once.
        if not isinstance(answer, GeneratedTraffic) and isinstance(answer, Iterable):
            answer = yield from self._steps(self._asked(lambda: iter(answer)))
        if not isinstance(answer, GeneratedTraffic):
            raise GenerationError(
                f"{self._place} returned a {type(answer).__name__}; expected "
                "GeneratedTraffic."
            )
        # What it says of itself may be anything, like all else that it returns.
        traffic = self._asked(lambda: _plain_traffic(answer))
        self._asked(lambda: check_traffic(traffic, request))
        return self._judged(traffic, request)

    def _asked(self, ask: Callable[[], Any]) -> Any:
        return asked(ask, self._place, " failed")

    def _steps(self, steps: Iterator[Any]) -> Generator[GenerationProgress, None, Any]:
        """Yield the progress of a plugin, return what it returns."""

        def next_step() -> tuple[bool, Any]:
            try:
                return True, next(steps)
            except StopIteration as stop:
                return False, stop.value

        try:
            while True:
                goes_on, value = self._asked(next_step)
                if not goes_on:
                    return value
                yield self._asked(lambda found=value: _plain_progress(found))
        finally:
            if isinstance(steps, Generator):
                self._asked(steps.close)

    def _judged(
        self, traffic: GeneratedTraffic, request: GenerationRequest
    ) -> GeneratedTraffic:
        """The traffic with our own report on guidance, which a plugin cannot claim."""
        if not request.terms:
            return replace(traffic, guidance=())
        if "guidance" not in self.supports:
            note = f"{self.name} takes no guidance: the guidance terms had no effect."
            return replace(traffic, guidance=(), notes=(*traffic.notes, note))
        reports = guidance_reports(request.scenario, traffic.samples, request.terms)
        return replace(traffic, guidance=reports)


def checked_name(name: Any) -> str:
    """The name of foreign code; raises TypeError unless it can be shown and stored."""
    if not isinstance(name, str) or not name or not is_plain(name):
        raise TypeError(
            f"{name!r}; expected a text of up to {MAX_ID_CHARACTERS} characters"
        )
    return name


def _plain_progress(found: Any) -> GenerationProgress:
    if not isinstance(found, GenerationProgress):
        raise TypeError(f"it yielded {found!r}; expected GenerationProgress")
    fraction = float(found.fraction)
    if not 0 <= fraction <= 1 or not isinstance(found.message, str):
        raise TypeError(f"it yielded {found!r}; expected a fraction from 0 to 1")
    return GenerationProgress(fraction=fraction, message=one_line(found.message))


def _plain_traffic(found: GeneratedTraffic) -> GeneratedTraffic:
    """A plugin's traffic with fields of the right types; raises TypeError otherwise."""
    notes = (found.notes,) if isinstance(found.notes, str) else tuple(found.notes)
    if not all(isinstance(note, str) for note in notes):
        raise TypeError(f"its notes are {notes!r}; expected texts")
    samples = tuple(map(_plain_sample, found.samples))
    slowed = tuple(map(tuple, found.slowed_ids))
    if slowed and not (
        len(slowed) == len(samples)
        and all(
            set(ids) <= set(sample.ids)
            for ids, sample in zip(slowed, samples, strict=True)
        )
    ):
        raise TypeError(f"its slowed_ids are {slowed!r}; expected agents per sample")
    return GeneratedTraffic(
        samples=samples,
        generator=checked_name(found.generator),
        model_sha256=one_line(str(found.model_sha256), MAX_ID_CHARACTERS),
        seed=operator.index(found.seed),
        elapsed_s=float(found.elapsed_s),
        notes=tuple(map(one_line, notes)),
        slowed_ids=slowed,
    )


def _plain_sample(found: Any) -> TrafficSample:
    if not isinstance(found, TrafficSample):
        raise TypeError(f"a sample is a {type(found).__name__}, no TrafficSample")
    arrays: dict[str, Any] = {}
    for field in ("size_m", "position_m", "heading_rad", "velocity_mps"):
        values = np.array(getattr(found, field))
        if values.dtype.kind not in "fiu":
            raise TypeError(f"{field} is of type {values.dtype}; expected numbers")
        arrays[field] = values.astype(float)
    for field, kind in (("ids", str), ("kinds", AgentKind), ("activity", Activity)):
        arrays[field] = tuple(getattr(found, field))
        if not all(isinstance(one, kind) for one in arrays[field]):
            raise TypeError(f"{field} are {arrays[field][:3]!r}...; expected {kind}")
    if len(arrays["activity"]) not in (0, len(arrays["ids"])):
        raise TypeError("activity must be empty, or have one value for each agent")
    return TrafficSample(**arrays)


@lru_cache(maxsize=1)
def installed_plugins() -> Mapping[str, EntryPoint]:
    """Entry points of installed packages, by name."""
    return {one.name: one for one in entry_points(group=ENTRY_POINTS)}


def generator_of_reference(reference: str) -> ScenarioGenerator:
    """The generator that ``package.module:attribute`` names.

    Raises:
        GenerationError: it cannot be imported, is not there, or is no generator.
    """
    return _as_generator(object_of_reference(reference), reference)


def generator_of_entry_point(name: str) -> ScenarioGenerator:
    """The generator that an installed package offers under a name.

    Raises:
        GenerationError: it cannot be loaded, or is no generator.
    """
    entry_point = installed_plugins()[name]
    return _as_generator(
        _imported(entry_point.load, f"{name} ({entry_point.value})"), name
    )


def generator_of_folder(folder: Path) -> ScenarioGenerator:
    """The generator that ``generator.py`` of a folder makes.

    The file is run as a module: name only folders that you trust.

    Raises:
        GenerationError: the file cannot be run, or makes no generator.
    """
    found = object_of_folder(folder, FOLDER_MODULE)
    return _as_generator(found, str(folder / FOLDER_MODULE))


def object_of_folder(folder: Path, file: str) -> Any:
    """What ``make_x(folder)`` of the file ``x.py`` of a folder makes.

    Raises:
        GenerationError: the file cannot be run, or has no such function, or it fails.
    """
    path = folder / file
    function = f"make_{path.stem}"

    def load() -> ModuleType:
        # As a package, whose modules are not those of another folder.
        own = zlib.crc32(os.fsencode(os.path.realpath(folder)))
        spec = importlib.util.spec_from_file_location(
            f"pd_editor_plugin_{path.stem}_{own:x}",
            path,
            submodule_search_locations=[str(folder)],
        )
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        # What was edited since is read again.
        for name in [one for one in sys.modules if one.startswith(f"{spec.name}.")]:
            del sys.modules[name]
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
        return module

    make = getattr(_imported(load, str(path)), function, None)
    if not callable(make):
        raise GenerationError(
            f"{path}: has no function {function}(folder), which makes the {path.stem}."
        )
    return asked(lambda: make(folder), str(path), f": making the {path.stem} failed")


def _imported(load: Callable[[], Any], place: str) -> Any:
    return asked(load, place, ": cannot be imported")


def _made(make: Callable[[], Any], place: str) -> Any:
    return asked(make, place, ": making the generator failed")


def _as_generator(found: Any, place: str) -> ScenarioGenerator:
    """An instance, out of an instance, a class or a function without arguments."""
    if isinstance(found, type) or not is_of(
        found, ScenarioGenerator | Predictor, place
    ):
        if not callable(found):
            raise _no_generator(found, place)
        found = _made(found, place)
    if is_of(found, ScenarioGenerator, place):
        return _Checked(found, place)
    if is_of(found, Predictor, place):
        return _Checked(PredictorGenerator(found), place)
    raise _no_generator(found, place)


def is_of(found: Any, kind: Any, place: str) -> bool:
    """Whether an object has the members of a protocol, which may be foreign properties."""
    return asked(lambda: isinstance(found, kind), place, ": cannot be looked at")


def _no_generator(found: Any, place: str) -> GenerationError:
    return GenerationError(
        f"{place}: is a {type(found).__name__}; expected an object with a name and "
        "generate(request) or predict(request), or a class or function without "
        "arguments that makes one."
    )
