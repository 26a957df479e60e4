"""Generators and predictors of one's own: from modules, entry points and folders.

A name of three forms is taken: ``package.module:attribute``, a name of the entry-point
group ``pd_editor.generators``, and a folder with ``generator.py``, which defines
``make_generator(folder)``. What is found is a generator, a predictor, or a class or
function that makes one without arguments.
"""

import importlib
import importlib.util
import os
import sys
import sysconfig
import traceback
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from pd_editor.errors import GenerationError, PdEditorError
from pd_editor.generation import (
    Capability,
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    ScenarioGenerator,
    check_supported,
    check_traffic,
    supported_by,
)
from pd_editor.generators.predictor_generator import PredictorGenerator
from pd_editor.guidance.report import guidance_reports
from pd_editor.plain_text import nearest_or_all
from pd_editor.prediction import Predictor

ENTRY_POINTS: Final = "pd_editor.generators"
FOLDER_MODULE: Final = "generator.py"
_FOLDER_FUNCTION: Final = "make_generator"
_OWN_CODE: Final = str(Path(__file__).parents[1])


class _Checked:
    """A plugin whose faults, and wrong answers, become one sentence for the user."""

    def __init__(self, generator: ScenarioGenerator, place: str) -> None:
        self._generator, self._place = generator, place
        self.supports: frozenset[Capability] = supported_by(generator)

    @property
    def name(self) -> str:
        """The plugin's own name."""
        return self._generator.name

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield the plugin's progress, return its traffic.

        Raises:
            GenerationError: the plugin does not support the request, raised something,
                or its answer does not fit.
        """
        check_supported(request, self.supports, self.name)
        try:
            answer = self._generator.generate(request)
            # A plugin without progress may return the traffic at once.
            traffic = (
                answer if isinstance(answer, GeneratedTraffic) else (yield from answer)
            )
        except PdEditorError as error:
            raise GenerationError(f"{self._place}: {error}") from error
        except Exception as error:
            raise GenerationError(
                f"{self._place} failed ({described(error)})."
            ) from error
        if not isinstance(traffic, GeneratedTraffic):
            raise GenerationError(
                f"{self._place} returned a {type(traffic).__name__}; expected "
                "GeneratedTraffic."
            )
        try:
            check_traffic(traffic, request)
        except GenerationError as error:
            raise GenerationError(f"{self._place}: {error}") from error
        return self._judged(traffic, request)

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


def described(error: Exception) -> str:
    """Class and text of an exception, and the line of the user's file, in one line."""
    places = [
        (frame.filename, frame.lineno)
        for frame in traceback.extract_tb(error.__traceback__)
    ]
    if isinstance(error, SyntaxError) and error.filename:
        places.append((error.filename, error.lineno))
    own = [place for place in places if _is_users(place[0])]
    at = f" in {Path(own[-1][0]).name}:{own[-1][1]}" if own else ""
    text = str(error.msg if isinstance(error, SyntaxError) else error)
    return f"{type(error).__name__}{': ' if text else ''}{text}{at}"


def _is_users(file: str) -> bool:
    """Whether code of a file is the user's, not ours, a library's or Python's."""
    return not (
        file.startswith(("<", _OWN_CODE, sysconfig.get_path("stdlib")))
        or "site-packages" in Path(file).parts
    )


@lru_cache(maxsize=1)
def installed_plugins() -> Mapping[str, EntryPoint]:
    """Entry points of installed packages, by name."""
    return {one.name: one for one in entry_points(group=ENTRY_POINTS)}


def origin_of(entry_point: EntryPoint) -> str:
    """Where an entry point is from, in words."""
    package = entry_point.dist.name if entry_point.dist else "an unknown package"
    return f"{entry_point.value} of the package {package}"


def generator_of_reference(reference: str) -> ScenarioGenerator:
    """The generator that ``package.module:attribute`` names.

    Modules are looked for in the current folder as well.

    Raises:
        GenerationError: it cannot be imported, is not there, or is no generator.
    """
    module_name, _, attribute = reference.partition(":")
    folder = os.getcwd()
    if folder not in sys.path:
        # A console script has its own folder there, not the one that it was run in.
        sys.path.append(folder)
    module = _imported(lambda: importlib.import_module(module_name), reference)
    found: Any = module
    for part in attribute.split("."):
        if not hasattr(found, part):
            public = [name for name in dir(found) if not name.startswith("_")]
            raise GenerationError(
                f"{reference}: {module_name} has no attribute {attribute!r}; "
                f"{nearest_or_all(part, public)}."
            )
        found = getattr(found, part)
    return _as_generator(found, reference)


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
    path = folder / FOLDER_MODULE

    def load() -> ModuleType:
        spec = importlib.util.spec_from_file_location(
            f"pd_editor_plugin_{folder.name}", path
        )
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
        return module

    make = getattr(_imported(load, str(path)), _FOLDER_FUNCTION, None)
    if not callable(make):
        raise GenerationError(
            f"{path}: has no function {_FOLDER_FUNCTION}(folder), which makes the "
            "generator."
        )
    return _as_generator(_made(lambda: make(folder), str(path)), str(path))


def _imported(load: Callable[[], Any], place: str) -> Any:
    try:
        return load()
    except Exception as error:
        raise GenerationError(
            f"{place}: cannot be imported ({described(error)})."
        ) from error


def _made(make: Callable[[], Any], place: str) -> Any:
    try:
        return make()
    except Exception as error:
        raise GenerationError(
            f"{place}: making the generator failed ({described(error)})."
        ) from error


def _as_generator(found: Any, place: str) -> ScenarioGenerator:
    """An instance, out of an instance, a class or a function without arguments."""
    if isinstance(found, type) or not isinstance(found, ScenarioGenerator | Predictor):
        if not callable(found):
            raise _no_generator(found, place)
        found = _made(found, place)
    if isinstance(found, ScenarioGenerator):
        return _Checked(found, place)
    if isinstance(found, Predictor):
        return _Checked(PredictorGenerator(found), place)
    raise _no_generator(found, place)


def _no_generator(found: Any, place: str) -> GenerationError:
    return GenerationError(
        f"{place}: is a {type(found).__name__}; expected an object with a name and "
        "generate(request) or predict(request), or a class or function without "
        "arguments that makes one."
    )
