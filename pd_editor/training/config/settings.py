"""Settings of a run by name, out of a TOML file and of ``key=value`` texts.

A name is a section and a field, ``model.width``; before it a stage, ``init.model.width``,
where both stages are trained. Sections are those of ``SECTIONS``.
"""

import difflib
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from pd_editor.errors import ModelError, TrainingError
from pd_editor.regular_file import read_regular

SECTIONS: Final = (
    "model",
    "loss",
    "optimisation",
    "augmentation",
    "sampler",
    "guidance",
    "own_samples",
)
STAGES: Final = ("init", "traj")
_MAX_BYTES: Final = 1_000_000
_Value = TypeVar("_Value")

Settings = Mapping[str, Mapping[str, Any]]
"""Values of fields, by section."""


def settings_of(files: Sequence[Path], texts: Sequence[str], stage: str) -> Settings:
    """What files and texts say for a stage; texts count before files, later ones first.

    Raises:
        TrainingError: a file is no TOML, a text is no ``key=value``, or a section is
            unknown.
    """
    found: dict[str, dict[str, Any]] = {}
    given = [(str(file), _read(file)) for file in files]
    given += [(f"--set {text}", _parsed(text)) for text in texts]
    for place, tree in given:
        own = tree.get(stage, {})
        shared = {name: one for name, one in tree.items() if name not in STAGES}
        for part in (shared, own):
            if not isinstance(part, Mapping):
                raise TrainingError(f"{place}: {stage} is no table of sections.")
            for section, fields in part.items():
                _check_name(place, section, SECTIONS, "section")
                if not isinstance(fields, Mapping):
                    raise TrainingError(
                        f"{place}: {section} is no table of fields; expected for "
                        f"example {section}.NAME=VALUE."
                    )
                found.setdefault(section, {}).update(fields)
    return found


def with_settings(value: _Value, given: Mapping[str, Any], section: str) -> _Value:
    """A dataclass of a config with other values in some fields.

    Raises:
        TrainingError: a field is unknown, or its value cannot be.
    """
    present = asdict(value)  # type: ignore[call-overload]
    for name in given:
        _check_name(section, name, present, "field")
    try:
        return msgspec.convert({**present, **given}, type(value))
    except msgspec.ValidationError as error:
        reason = str(error).replace("`$.", f"`{section}.")
        raise TrainingError(f"{section}: {reason}.") from error
    except ModelError as error:
        raise TrainingError(f"{section}: {error}") from error


def _check_name(place: str, name: str, known: Iterable[str], what: str) -> None:
    names = list(known)
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1) or [", ".join(names)]
        raise TrainingError(
            f"{place}: there is no {what} {name!r}; the nearest is {near[0]}."
            if near[0] in names
            else f"{place}: there is no {what} {name!r}; expected one of {near[0]}."
        )


def _read(file: Path) -> dict[str, Any]:
    text = read_regular(file, max_bytes=_MAX_BYTES, error=TrainingError)
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
