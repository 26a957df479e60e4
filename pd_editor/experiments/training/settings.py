"""Settings of a run by name, of TOML files and ``key=value`` texts, and the configuration.

A name is a section and a field, ``model.width``; before it a stage, ``init.model.width``,
where both stages are trained. ``SECTIONS`` has the sections of each stage.
"""

import ast
import inspect
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from textwrap import dedent
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec
import torch

from pd_editor.base.errors import ModelError, TrainingError
from pd_editor.base.plain_text import markdown_table, nearest_or_all
from pd_editor.base.regular_file import read_regular
from pd_editor.experiments.training.run_config import (
    Augmentation,
    Budget,
    Optimisation,
    OwnSamplesConfig,
    Precision,
    RunConfig,
)
from pd_editor.generation.checkpoints.tensor_file import config_from_json
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.loss import InitialStateLossConfig
from pd_editor.generation.initial_state.network.denoiser import InitialStateConfig
from pd_editor.generation.initial_state.placement_rules import ConflictResampling
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.generation.trajectory.guidance.nearest_candidate import (
    TrajectoryGuidance,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import TermGuidance
from pd_editor.generation.trajectory.loss import TrajectoryLossConfig
from pd_editor.generation.trajectory.network.denoiser import TrajectoryConfig
from pd_editor.generation.trajectory.sampler import TrajectorySamplerConfig

PresetName = Literal["default", "gpu", "av2", "tiny"]


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Size of a network, optimisation, and duration of training."""

    model: Mapping[str, Any]
    optimisation: Optimisation
    minutes: float
    windows: int = 1
    """Number of current steps at which each scenario of Argoverse 2 is used."""


NETWORKS: Final[Mapping[str, type[Any]]] = {
    "traj": TrajectoryConfig,
    "init": InitialStateConfig,
}
"""Configuration of each stage's network."""
LOSSES: Final[Mapping[str, type[Any]]] = {
    "traj": TrajectoryLossConfig,
    "init": InitialStateLossConfig,
}
"""Type of each stage's loss settings; all presets use the defaults."""
SAMPLING: Final[Mapping[str, Mapping[str, type[Any]]]] = {
    "traj": {
        "sampler": TrajectorySamplerConfig,
        "guidance": TrajectoryGuidance,
        "terms": TermGuidance,
    },
    "init": {
        "sampler": InitialStateSamplerConfig,
        "guidance": InitialStateGuidance,
        "conflicts": ConflictResampling,
    },
}
"""Types of each stage's settings of the sampling, stored beside the weights."""
_GO_ON: Final = Optimisation(batch_size=64, learning_rate=5e-4, ema_decay=0.9995)
_TRY_OUT: Final = Optimisation(batch_size=4, warmup_steps=10, ema_decay=0.98)
PRESETS: Final[Mapping[str, Mapping[PresetName, Preset]]] = {
    "traj": {
        "default": Preset(
            model=asdict(TrajectoryConfig()),
            optimisation=Optimisation(batch_size=16, learning_rate=1.5e-3),
            minutes=20.0,
        ),
        "gpu": Preset(
            model=asdict(TrajectoryConfig(width=192, num_blocks=4)),
            optimisation=Optimisation(batch_size=256, learning_rate=1.5e-3),
            minutes=12.0,
        ),
        "av2": Preset(
            model=asdict(TrajectoryConfig()),
            optimisation=_GO_ON,
            minutes=240.0,
            windows=5,
        ),
        "tiny": Preset(
            model=asdict(
                TrajectoryConfig(width=32, num_heads=4, num_blocks=1, edge_width=16)
            ),
            optimisation=_TRY_OUT,
            minutes=1.0,
        ),
    },
    "init": {
        "default": Preset(
            model=asdict(InitialStateConfig()),
            optimisation=Optimisation(batch_size=16, learning_rate=2e-3),
            minutes=30.0,
        ),
        "gpu": Preset(
            model=asdict(InitialStateConfig(width=192, num_layers=4)),
            optimisation=Optimisation(batch_size=192, learning_rate=1.5e-3),
            minutes=15.0,
        ),
        "av2": Preset(
            model=asdict(InitialStateConfig()),
            optimisation=_GO_ON,
            minutes=240.0,
            windows=5,
        ),
        "tiny": Preset(
            model=asdict(InitialStateConfig(width=32, num_layers=1, relation_width=16)),
            optimisation=_TRY_OUT,
            minutes=1.0,
        ),
    },
}


StageName = Literal["init", "traj"]
STAGES: Final[tuple[StageName, ...]] = ("init", "traj")
SECTIONS: Final[Mapping[str, Mapping[str, type[Any]]]] = {
    stage: {
        "model": NETWORKS[stage],
        "loss": LOSSES[stage],
        "optimisation": Optimisation,
        "augmentation": Augmentation,
        **SAMPLING[stage],
        "own_samples": OwnSamplesConfig,
    }
    for stage in STAGES
}
"""Types of the sections that can be set, for each stage."""
_KINDS: Final[Mapping[Any, str]] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    tuple[float, float]: "two numbers, [LOW, HIGH]",
}
_Value = TypeVar("_Value")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Values of fields by section, and the files and texts that they are from."""

    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    places: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Files and texts of each section."""

    def of(self, section: str) -> Mapping[str, Any]:
        """Values of the fields of a section that were given."""
        return self.values.get(section, {})

    def place(self, section: str, stage: str) -> str:
        """Where the values of a section are from, in words."""
        given = ", ".join(self.places.get(section, ()))
        return f"{given}: [{stage}.{section}]" if given else f"[{stage}.{section}]"


def settings_of(files: Sequence[Path], texts: Sequence[str], stage: str) -> Settings:
    """What files and texts say for a stage; texts count before files, later ones first.

    Raises:
        TrainingError: a file is no TOML, a text is no ``key=value``, or the stage has no
            such section, field or type of value.
    """
    found: dict[str, dict[str, Any]] = {}
    places: dict[str, tuple[str, ...]] = {}
    other = _other_than(stage)
    given = [(str(file), _read(file)) for file in files]
    given += [(f"--set {text}", _parsed(text)) for text in texts]
    for place, tree in given:
        shared = {name: one for name, one in tree.items() if name not in STAGES}
        for part in (shared, tree.get(stage, {})):
            if not isinstance(part, Mapping):
                raise TrainingError(f"{place}: {stage} is no table of sections.")
            for section, values in part.items():
                if section in SECTIONS[other] and section not in SECTIONS[stage]:
                    raise TrainingError(
                        f"{place}: only the stage {other} has a section {section!r}; "
                        f"expected [{other}.{section}], or {other}.{section}.NAME=VALUE."
                    )
                if section not in SECTIONS[stage]:
                    raise TrainingError(
                        f"{place}: there is no section {section!r}; "
                        f"{nearest_or_all(section, SECTIONS[stage])}."
                    )
                if not isinstance(values, Mapping):
                    raise TrainingError(
                        f"{place}: {section} is no table of fields; expected for "
                        f"example {section}.NAME=VALUE."
                    )
                _check_fields(values, section, stage, place)
                found.setdefault(section, {}).update(values)
                places[section] = (*places.get(section, ()), place)
    return Settings(values=found, places=places)


def _field_types(config_type: type[Any]) -> dict[str, Any]:
    hints = get_type_hints(config_type)
    return {one.name: hints[one.name] for one in fields(config_type)}


def _check_fields(
    values: Mapping[str, Any], section: str, stage: str, place: str
) -> None:
    """Raise for fields that the stage does not have, and for values of another type."""
    place = f"{place}: [{stage}.{section}]"
    kinds = _field_types(SECTIONS[stage][section])
    other = _other_than(stage)
    is_shared = section in SECTIONS[other]
    theirs = _field_types(SECTIONS[other][section]) if is_shared else {}
    for name, value in values.items():
        if name in theirs and name not in kinds:
            raise TrainingError(
                f"{place} has no field {name!r}; [{other}.{section}] has it, expected it "
                "there."
            )
        _check_name(place, name, kinds)
        try:
            msgspec.convert(value, kinds[name])
        except msgspec.ValidationError as error:
            raise TrainingError(
                f"{place} {name} is {_as_text(value)}; expected {in_words(kinds[name])}."
            ) from error


def _other_than(stage: str) -> str:
    return next(one for one in STAGES if one != stage)


def _as_text(value: Any) -> str:
    """A value as TOML writes it."""
    return str(value).lower() if isinstance(value, bool) else repr(value)


def in_words(kind: Any) -> str:
    """What values a field may have, by its type."""
    if get_origin(kind) is Literal:
        return " or ".join(map(repr, get_args(kind)))
    return _KINDS[kind]


def with_settings(value: _Value, given: Mapping[str, Any], place: str) -> _Value:
    """A dataclass of a config with other values in some fields.

    Raises:
        TrainingError: the values cannot be; the message begins with the place.
    """
    present = asdict(value)  # type: ignore[call-overload]
    for name in given:
        _check_name(place, name, present)
    try:
        return msgspec.convert({**present, **given}, type(value))
    except msgspec.ValidationError as error:
        reason = str(error).partition(" - at `$")[0]
        raise TrainingError(f"{place} {reason}.") from error
    except (ModelError, TrainingError) as error:
        raise TrainingError(f"{place} {error}") from error


def _check_name(place: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise TrainingError(
            f"{place} has no field {name!r}; {nearest_or_all(name, known)}."
        )


def _read(file: Path) -> dict[str, Any]:
    text = read_regular(file, max_bytes=1_000_000, error=TrainingError)
    try:
        return tomllib.loads(text.decode() if isinstance(text, bytes) else text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TrainingError(f"{file}: is no TOML ({error}).") from error


def _parsed(text: str) -> dict[str, Any]:
    """``a.b=c`` as nested tables; what is no TOML value is a text."""
    key, sign, value = text.partition("=")
    parts = [part.strip() for part in key.split(".")]
    if not sign or len(parts) not in (2, 3) or not all(parts):
        raise TrainingError(
            f"--set {text}: expected SECTION.FIELD=VALUE, such as model.width=96."
        )
    try:
        tree: Any = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        tree = value
    for part in reversed(parts):
        tree = {part: tree}
    return tree


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """Requested settings of a run; None selects the default."""

    stage: StageName
    data: tuple[str, ...] | None = None
    """Absolute paths of the data roots."""
    weights: tuple[float, ...] | None = None
    preset: PresetName | None = None
    minutes: float | None = None
    steps: int | None = None
    batch_size: int | None = None
    learning_rate: float | None = None
    precision: Precision | None = None
    seed: int | None = None
    start: str | None = None
    """Absolute path of a model."""
    validate: tuple[str, ...] | None = None
    """Absolute paths of roots."""
    windows: int | None = None
    copies: int | None = None
    settings: Settings = field(default_factory=Settings)
    """Values of single fields, by section; they count before the preset."""

    def given(self, part: type[Any]) -> dict[str, Any]:
        """What is asked for of the fields of a part of the configuration."""
        asked = {one.name: getattr(self, one.name, None) for one in fields(part)}
        return {name: value for name, value in asked.items() if value is not None}

    def with_settings(self, value: _Value, section: str) -> _Value:
        """A dataclass with the values that are given for a section.

        Raises:
            TrainingError: they cannot be; the message has their files and the stage.
        """
        place = self.settings.place(section, self.stage)
        return with_settings(value, self.settings.of(section), place)


def new_config(request: RunRequest, *, is_gpu: bool) -> RunConfig:
    """Configuration of a new run.

    Raises:
        TrainingError: the settings are invalid, or there is no data.
    """
    if not request.data:
        raise TrainingError(
            "No data was given; expected --data with the root of an Argoverse 2 "
            "dataset or a folder of synthetic shards."
        )
    preset = PRESETS[request.stage][request.preset or ("gpu" if is_gpu else "default")]
    usual = {"precision": fast_precision(is_gpu=is_gpu), "windows": preset.windows}
    return RunConfig(
        **{**usual, **request.given(RunConfig)},
        model=_model_of(request, preset),
        loss=asdict(request.with_settings(LOSSES[request.stage](), "loss")),
        own_samples=asdict(request.with_settings(OwnSamplesConfig(), "own_samples"))
        if request.settings.of("own_samples")
        else {},
        augmentation=asdict(request.with_settings(Augmentation(), "augmentation")),
        sampling=_sampling_of(request),
        optimisation=with_settings(
            request.with_settings(preset.optimisation, "optimisation"),
            request.given(Optimisation),
            "optimisation",
        ),
        budget=_requested_budget(Budget(minutes=preset.minutes), request),
    )


def continued_config(earlier: RunConfig, request: RunRequest) -> RunConfig:
    """Configuration of a resumed run: the earlier one, possibly with another budget.

    Raises:
        TrainingError: other settings are requested.
    """
    other = [
        "from" if name == "start" else name.replace("_", "-")
        for part in (earlier, earlier.optimisation)
        for name, value in request.given(type(part)).items()
        if value != getattr(part, name)
    ]
    if request.preset is not None:
        model = _model_of(request, PRESETS[request.stage][request.preset])
        other += ["preset"] * (model != earlier.model)
    other += [
        f"{section}.{name}"
        for section, given in request.settings.values.items()
        for name, value in given.items()
        if section_of(earlier, section).get(name) != value
    ]
    if other:
        raise TrainingError(
            f"The run was begun with another {' and '.join(other)}; leave that out to "
            "go on with it, or begin a new run."
        )
    return replace(earlier, budget=_requested_budget(earlier.budget, request))


def fast_precision(*, is_gpu: bool) -> Precision:
    """Choose bf16 where it makes matrix products much faster."""
    # Older versions of torch do not provide this.
    capabilities = getattr(torch.cpu, "get_capabilities", dict)()
    return "bf16" if is_gpu or capabilities.get("amx_tile", False) else "32"


def _requested_budget(budget: Budget, request: RunRequest) -> Budget:
    given = request.given(Budget)
    if "minutes" in given:
        budget = replace(budget, steps=None)
    return replace(budget, **given)


def _model_of(request: RunRequest, preset: Preset) -> Mapping[str, Any]:
    network = config_from_json(NETWORKS[request.stage], preset.model, "the preset")
    return asdict(request.with_settings(network, "model"))


def _sampling_of(request: RunRequest) -> Mapping[str, Mapping[str, Any]]:
    """Settings of the sampling that were given, checked."""
    found: dict[str, Mapping[str, Any]] = {}
    for name, kind in SAMPLING[request.stage].items():
        if given := request.settings.of(name):
            request.with_settings(kind(), name)
            found[name] = dict(given)
    return found


def section_of(config: RunConfig, section: str) -> Mapping[str, Any]:
    """Fields of a section of a configuration, as in a file."""
    if section in SAMPLING[config.stage]:
        return config.sampling.get(section, {})
    found = asdict(config)[section]
    # Values of a file are lists where a config has tuples.
    return {
        name: list(one) if isinstance(one, tuple) else one
        for name, one in found.items()
    }


def fields_table(stage: StageName) -> str:
    """The fields of a stage, in the order of its sections, as a table in Markdown."""
    preset = PRESETS[stage]["default"]
    usual = {
        "model": dict(preset.model),
        "optimisation": asdict(preset.optimisation),
    }
    rows: list[tuple[str, ...]] = []
    for section, kind in SECTIONS[stage].items():
        meanings, hints = _docstrings(kind), get_type_hints(kind)
        for name, default in (asdict(kind()) | usual.get(section, {})).items():
            meaning = _first_sentence(meanings.get(name, ""))
            field_name = f"`{stage}.{section}.{name}`"
            rows.append((field_name, _as_toml(default), in_words(hints[name]), meaning))
    return markdown_table(("field", "default", "values", "meaning"), rows)


def _docstrings(kind: type[Any]) -> dict[str, str]:
    """Docstrings under the fields of a class, by name."""
    (tree,) = ast.parse(dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for line, after in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(line, ast.AnnAssign)
            and isinstance(line.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        ):
            found[line.target.id] = inspect.cleandoc(str(after.value.value))
    return found


def _first_sentence(text: str) -> str:
    words = " ".join(text.split())
    head, dot, _ = words.partition(". ")
    return head + "." * bool(dot)


def _as_toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return str(list(value))
    return f'"{value}"' if isinstance(value, str) else str(value)
