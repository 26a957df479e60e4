"""Registry of all generators by name; models are loaded on demand."""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pd_editor.diffusion.defaults import (
    DEFAULT_WEIGHT,
    NUM_STEPS,
    NUM_TRIES,
    DeviceName,
)
from pd_editor.errors import GenerationError
from pd_editor.generation import GeneratorSpec, ScenarioGenerator
from pd_editor.installed_files import models_folder

if TYPE_CHECKING:
    from pd_editor.diffusion.path_diffuser import PathDiffuser

SHIPPED_MODEL: Final = "path-diffuser"
MODEL_CONFIG: Final = "config.json"
"""File that identifies a model folder."""


def _lane_follower() -> ScenarioGenerator:
    from pd_editor.lane_follower import LaneFollower

    return LaneFollower()


@lru_cache(maxsize=8)
def _path_diffuser(
    folder: Path, name: str, device: DeviceName = "auto"
) -> "PathDiffuser":
    """Load a model; its weights are read once per process."""
    from pd_editor.diffusion.path_diffuser import PathDiffuser

    return PathDiffuser(folder, name, device)


def _shipped_model(device: DeviceName = "auto") -> "PathDiffuser":
    return _path_diffuser(models_folder() / SHIPPED_MODEL, SHIPPED_MODEL, device)


def _model_offer(make: Callable[[], "PathDiffuser"]) -> GeneratorSpec:
    return GeneratorSpec(
        make=make,
        samples_states=True,
        default_num_steps=NUM_STEPS,
        default_guidance=DEFAULT_WEIGHT,
        default_num_tries=NUM_TRIES,
        warm_up=lambda: make().warm_up(),
    )


def _offers() -> dict[str, GeneratorSpec]:
    """All generators, the shipped model first if its weights are installed."""
    offers: dict[str, GeneratorSpec] = {}
    if (models_folder() / SHIPPED_MODEL / MODEL_CONFIG).is_file():
        offers[SHIPPED_MODEL] = _model_offer(_shipped_model)
    offers["lane-follower"] = GeneratorSpec(make=_lane_follower)
    return offers


GENERATORS: Final[Mapping[str, GeneratorSpec]] = _offers()
DEFAULT_GENERATOR: Final = next(iter(GENERATORS))


def offers_with(models: Sequence[Path]) -> Mapping[str, GeneratorSpec]:
    """Models in some folders, named after the folders, followed by all generators.

    Raises:
        GenerationError: a folder holds no model, or has the name of another generator.
    """
    offers: dict[str, GeneratorSpec] = {}
    for folder in map(Path.resolve, models):
        name = folder.name
        if not (folder / MODEL_CONFIG).is_file():
            raise GenerationError(
                f"{folder}: not a trained model; expected a folder with {MODEL_CONFIG}."
            )
        if name in offers or name in GENERATORS:
            raise GenerationError(
                f"{folder}: there is a generator {name!r} already; rename the folder."
            )
        offers[name] = _model_offer(partial(_path_diffuser, folder, name))
    return {**offers, **GENERATORS}


def make_generator(name: str, *, device: DeviceName = "auto") -> ScenarioGenerator:
    """Make the generator of a name, or the model in a folder.

    Only models use the device.

    Raises:
        GenerationError: there is none, or there is no GPU although one is requested.
    """
    if name == SHIPPED_MODEL and name in GENERATORS:
        return _shipped_model(device)
    if name in GENERATORS:
        return GENERATORS[name].make()
    folder = Path(name)
    if (folder / MODEL_CONFIG).is_file():
        return _path_diffuser(folder.resolve(), folder.resolve().name, device)
    raise GenerationError(
        f"There is no generator {name!r}; choose one of {', '.join(GENERATORS)}, or "
        "the folder of a trained model."
    )
