"""Settings of a run by name, out of TOML files and of ``key=value`` texts.

A name is a section and a field, ``model.width``; before it a stage, ``init.model.width``,
where both stages are trained. ``SECTIONS`` has the sections of each stage.
"""

import ast
import inspect
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from textwrap import dedent
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from pd_editor.base.errors import ModelError, TrainingError
from pd_editor.base.plain_text import markdown_table, nearest_or_all
from pd_editor.base.regular_file import read_regular
from pd_editor.experiments.training.run_config import (
    Augmentation,
    Optimisation,
    OwnSamplesConfig,
)
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
class SettableField:
    """A field of a section of a stage."""

    section: str
    name: str
    default: str
    """As TOML writes it."""
    values: str
    """What values it may have, in words."""
    meaning: str
    """The first sentence of its docstring."""


def settable_fields(stage: StageName) -> tuple[SettableField, ...]:
    """The fields of a stage, in the order of its sections."""
    preset = PRESETS[stage]["default"]
    usual = {
        "model": dict(preset.model),
        "optimisation": asdict(preset.optimisation),
    }
    found: list[SettableField] = []
    for section, kind in SECTIONS[stage].items():
        meanings, hints = _docstrings(kind), get_type_hints(kind)
        for name, default in (asdict(kind()) | usual.get(section, {})).items():
            found.append(
                SettableField(
                    section=section,
                    name=name,
                    default=_as_toml(default),
                    values=in_words(hints[name]),
                    meaning=_first_sentence(meanings.get(name, "")),
                )
            )
    return tuple(found)


def fields_table(stage: StageName) -> str:
    """The fields of a stage as a table in Markdown."""
    header = ("field", "default", "values", "meaning")
    rows = [
        (f"`{stage}.{one.section}.{one.name}`", one.default, one.values, one.meaning)
        for one in settable_fields(stage)
    ]
    return markdown_table(header, rows)


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
