"""All generators by name; heavy ones are made when they are asked for."""

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pd_editor.base.errors import GenerationError, InputError
from pd_editor.base.foreign_code import is_reference, origin_of
from pd_editor.base.installed_files import models_folder
from pd_editor.base.plain_text import is_plain, nearest_or_all, one_line
from pd_editor.base.regular_file import check_regular, read_regular
from pd_editor.generation.defaults import (
    DEFAULT_WEIGHT,
    MAX_CONFIG_BYTES,
    MAX_FILE_BYTES,
    NUM_STEPS,
    NUM_TRIES,
    DeviceName,
)
from pd_editor.generation.plugins import (
    FOLDER_MODULE,
    generator_of_entry_point,
    generator_of_folder,
    generator_of_reference,
    installed_plugins,
)
from pd_editor.scene.generation import (
    CAPABILITIES,
    Capability,
    GeneratorSpec,
    ScenarioGenerator,
    supported_by,
)

if TYPE_CHECKING:
    from pd_editor.generation.path_diffuser import PathDiffuser


SHIPPED_MODEL: Final = "path-diffuser"
"""The default among the shipped models."""
MODEL_CONFIG: Final = "config.json"
"""The file that makes a folder a model."""
USUAL_WARP_SHARE: Final = 0.3
"""Share of warped roads in trainings before it was recorded."""


def warp_share(record: Mapping[str, Any]) -> float:
    """Share of warped roads in a training, without those before it."""
    return float(record.get("augmentation", {}).get("warp_share", USUAL_WARP_SHARE))


def saw_warps(record: Mapping[str, Any]) -> bool:
    """Whether weights were ever trained on warped roads: in this training or before it.

    A record of an earlier version does not tell what the weights saw that it began with;
    they count as having seen warped roads.
    """
    found = record.get("saw_warps")
    if found is None:
        found = warp_share(record) > 0 or bool(record.get("start"))
    return bool(found) or any(map(saw_warps, record.get("averaged_with", ())))


@dataclass(frozen=True, kw_only=True)
class UnusableGenerator:
    """A generator that was found and cannot be offered."""

    name: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class GeneratorCatalogue:
    """Generators that may be chosen, and those that were found broken."""

    offers: Mapping[str, GeneratorSpec]
    unusable: tuple[UnusableGenerator, ...] = ()


def _lane_follower() -> ScenarioGenerator:
    from pd_editor.generation.lane_follower import LaneFollower

    return LaneFollower()


@lru_cache(maxsize=32)
def _path_diffuser(
    folder: Path, name: str, device: DeviceName = "auto"
) -> "PathDiffuser":
    """Weights are read once."""
    from pd_editor.generation.path_diffuser import PathDiffuser

    return PathDiffuser(folder, name, device)


def _shipped_model(name: str, device: DeviceName = "auto") -> "PathDiffuser":
    return _path_diffuser(models_folder() / name, name, device)


def shipped_models() -> tuple[str, ...]:
    """Names of the models that come with the program, the default first."""
    names = {file.parent.name for file in models_folder().glob(f"*/{MODEL_CONFIG}")}
    return tuple(sorted(names, key=lambda name: (name != SHIPPED_MODEL, name)))


def _stages(folder: Path) -> Mapping[str, Any]:
    content = read_regular(folder / MODEL_CONFIG, max_bytes=MAX_CONFIG_BYTES)
    stages = json.loads(content)["stages"]
    if not isinstance(stages, dict):
        raise TypeError("stages")
    return stages


def _shipped_origin(name: str) -> str:
    stages = _stages(models_folder() / name)
    records = [stage.get("training", {}) for stage in stages.values()]
    return (
        "shipped with the editor"
        if any(map(saw_warps, records))
        else "shipped, never saw a warped road"
    )


def _model_offer(
    make: Callable[[], "PathDiffuser"],
    origin: str,
    supports: frozenset[Capability] = CAPABILITIES,
) -> GeneratorSpec:
    return GeneratorSpec(
        make=make,
        origin=origin,
        supports=supports,
        default_num_steps=NUM_STEPS,
        default_guidance=DEFAULT_WEIGHT,
        default_num_tries=NUM_TRIES,
        warm_up=lambda: make().warm_up(),
    )


def _offers() -> dict[str, GeneratorSpec]:
    """The shipped models first, if their weights are there."""
    offers = {
        name: _model_offer(partial(_shipped_model, name), _shipped_origin(name))
        for name in shipped_models()
    }
    offers["lane-follower"] = GeneratorSpec(
        make=_lane_follower, origin="rules, without learning"
    )
    return offers


GENERATORS: Final[Mapping[str, GeneratorSpec]] = _offers()
DEFAULT_GENERATOR: Final = next(iter(GENERATORS))


def catalogue_with(models: Sequence[str | Path]) -> GeneratorCatalogue:
    """All generators, the default first.

    Those that are named come before the shipped ones. After these come the models of
    folders with several, of which none is preferred, and installed plugins.

    Args:
        models: folders of models or with ``generator.py``, folders of such folders, and
            ``package.module:attribute``. Plugins are loaded at once.

    Raises:
        GenerationError: a folder holds nothing of the kind, or has the name of another
            generator.
    """
    offers: dict[str, GeneratorSpec] = {}
    among_several: set[str] = set()
    unusable: list[UnusableGenerator] = []
    for given in map(str, models):
        if is_reference(given) and not os.path.exists(Path(given)):
            _add_plugin(offers, unusable, given, given)
            continue
        folders = _folders_in(Path(os.path.realpath(given)))
        if len(folders) > 1:
            among_several.update(folder.name for folder in folders)
        for folder in folders:
            reason = _damage(folder)
            if reason:
                unusable.append(UnusableGenerator(name=folder.name, reason=reason))
            elif os.path.isfile(folder / MODEL_CONFIG):
                make = partial(_path_diffuser, folder, folder.name)
                offer = _model_offer(make, str(folder), _supported_by_stages(folder))
                _add(offers, folder.name, offer, folder)
            else:
                _add_plugin(offers, unusable, str(folder), folder.name, folder)
    offers |= GENERATORS
    for name in [one for one in offers if one in among_several]:
        offers[name] = offers.pop(name)
    for name, entry_point in installed_plugins().items():
        if name not in offers:
            # It may be slow to import, and was not asked for: it refuses what it cannot.
            offers[name] = GeneratorSpec(
                make=partial(generator_of_entry_point, name),
                origin=origin_of(entry_point),
                supports=CAPABILITIES,
            )
    return GeneratorCatalogue(offers=offers, unusable=tuple(unusable))


def _add_plugin(
    offers: dict[str, GeneratorSpec],
    unusable: list[UnusableGenerator],
    given: str,
    name: str,
    folder: Path | None = None,
) -> None:
    """Load a plugin that was named, to know what it can do, and whether it is broken."""
    try:
        plugin = make_generator(given)
    except GenerationError as error:
        reason = str(error).removesuffix(".")
        for place in (str(Path(given) / FOLDER_MODULE), given):
            reason = reason.removeprefix(f"{place}: ")
        unusable.append(UnusableGenerator(name=name, reason=reason))
        return
    supports = supported_by(plugin)
    can = ", ".join(["trajectories", *sorted(supports)])
    only = "" if supports else " only"
    origin = f"your own code: {can}{only}" if folder is None else str(folder)
    offer = GeneratorSpec(make=lambda: plugin, origin=origin, supports=supports)
    _add(offers, name, offer, folder)


def _add(
    offers: dict[str, GeneratorSpec],
    name: str,
    offer: GeneratorSpec,
    folder: Path | None = None,
) -> None:
    if name in offers or name in GENERATORS:
        cure = "name it once" if folder is None else "rename the folder"
        raise GenerationError(
            f"{folder or name}: there is a generator {name!r} already; {cure}."
        )
    offers[name] = offer


def _folders_in(folder: Path) -> list[Path]:
    """The folder itself, or those directly in it that hold a generator."""
    if _holds_generator(folder):
        return [folder]
    found: list[Path] = []
    if os.path.isdir(folder):
        found = [one for one in sorted(folder.iterdir()) if _holds_generator(one)]
    if not found:
        raise GenerationError(
            f"{folder}: not a trained model; expected a folder with {MODEL_CONFIG} or "
            f"{FOLDER_MODULE}, or a folder of such folders."
        )
    return found


def _holds_generator(folder: Path) -> bool:
    return any(os.path.isfile(folder / name) for name in (MODEL_CONFIG, FOLDER_MODULE))


def _damage(folder: Path) -> str:
    """Defect of a model folder that is found without loading its weights."""
    config = folder / MODEL_CONFIG
    if not os.path.isfile(config):
        return ""
    try:
        stages = _stages(folder)
    except (InputError, ValueError, RecursionError):
        return f"{MODEL_CONFIG} is not readable JSON"
    except (LookupError, TypeError):
        return f"{MODEL_CONFIG} lists no stages"
    files = sorted(folder.glob("*.safetensors"))
    if not files:
        return "the weights (*.safetensors) are missing"
    for name, stage in stages.items():
        entry: dict[str, Any] = stage if isinstance(stage, dict) else {}
        file = str(entry.get("file", ""))
        is_name = is_plain(file) and Path(file).name == file != ""
        found = map(_sha256, [folder / file] if is_name else files)
        if entry.get("sha256") not in [one for one in found if one]:
            return (
                f"the weights of the stage {one_line(name, 60)} are not those that "
                f"{MODEL_CONFIG} lists: missing, damaged or of another model"
            )
    return ""


def _sha256(path: Path) -> str:
    """Hash of a file; empty if it cannot be weights."""
    try:
        check_regular(path, max_bytes=MAX_FILE_BYTES)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (InputError, OSError):
        return ""


def _supported_by_stages(folder: Path) -> frozenset[Capability]:
    """What a model can do with the stages that it has; without one it is told at a run."""
    return CAPABILITIES if "init" in _stages(folder) else frozenset({"guidance"})


def is_generator(name: str) -> bool:
    """Whether ``make_generator`` would find something of a name to load."""
    return (
        name in GENERATORS
        or name in installed_plugins()
        or _holds_generator(Path(name))
        or is_reference(name)
    )


def make_generator(name: str, *, device: DeviceName = "auto") -> ScenarioGenerator:
    """The generator of a name: a built-in or installed one, a folder, or a reference.

    Only models care about the device.

    Raises:
        GenerationError: there is none, it cannot be loaded, or there is no GPU although
            one is asked for.
    """
    if name in shipped_models():
        return _shipped_model(name, device)
    if name in GENERATORS:
        return GENERATORS[name].make()
    folder = Path(name)
    if os.path.isfile(folder / MODEL_CONFIG):
        return _path_diffuser(
            Path(os.path.realpath(folder)),
            os.path.basename(os.path.realpath(folder)),
            device,
        )
    if os.path.isfile(folder / FOLDER_MODULE):
        return generator_of_folder(Path(os.path.realpath(folder)))
    if name in installed_plugins():
        return generator_of_entry_point(name)
    if is_reference(name):
        return generator_of_reference(name)
    known = [*GENERATORS, *installed_plugins()]
    raise GenerationError(
        f"There is no generator {name!r}; {nearest_or_all(name, known)} (the folder of a "
        "trained model and package.module:attribute are taken as well)."
    )
