"""Numbers of a recipe's commands by names, as a family varies them and lists tell them.

Angles are in degrees here, and in radians in recipes.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    RegeneratedEdit,
    RemoveGuidance,
    ReplaceTraffic,
    SetRoadWarp,
    command_from_json,
    command_to_json,
)
from pd_editor.editor.recipe import Recipe

_RANGE: Final = re.compile(r"([\w.-]+)=([-+\d.eE]+?)\.\.([-+\d.eE]+)")
_MOST_TOLD: Final = 24
_SAMPLED: Final = ("sample", "past", "num_samples", "sample_index")
"""Fields of motion, which is sampled anew and not varied, and of which sample it is."""
_UNITS: Final = {"deg": "°", "mps2": " m/s²", "mps": " m/s", "m": " m", "s": " s"}
_UNIT: Final = re.compile(rf"_({'|'.join(_UNITS)})(?=\.|$)")
_OF_NO_FUTURE: Final = AddGuidance | ChangeGuidance | RemoveGuidance | SetRoadWarp
"""Edits that do the same whatever agents do later."""
_Path = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class VariedNumber:
    """A number of a recipe's commands, and the range that it is varied over."""

    path: _Path
    """Number of the entry from 1, then fields and places in lists, as the recipe has them."""
    name: str
    low: float
    high: float
    is_whole: bool

    def at(self, share: float) -> float:
        """The value at a share of the range, from 0 to 1."""
        if self.is_whole:
            low, high = round(self.low), round(self.high)
            return min(low + int(share * (high - low + 1)), high)
        return round(self.low + share * (self.high - self.low), 6)


def varied_numbers(
    recipe: Recipe, texts: Sequence[str], *, adds: bool = False
) -> tuple[VariedNumber, ...]:
    """Read ranges such as ``power=4..8``, ``2.seed=1..99`` or ``point_m.0=-45..-35``.

    ``seed`` is that of each run, and with ``adds`` of the traffic that variants get at
    their end.

    Raises:
        RecipeError: there is no text, or one is no range, names no number or several, or
            one that is named already.
    """
    known = _numbers(recipe, adds)
    told = [one for text in texts for one in _varied_by(text, known)]
    found = {one.path: one for one in told}
    if not texts:
        raise RecipeError("A family needs a range, such as power=4..8.")
    if len(found) < len(told):
        raise RecipeError("Two ranges are of the same number; expected one for each.")
    names = _names(found)
    return tuple(replace(one, name=names[path]) for path, one in found.items())


def varied(recipe: Recipe, values: Mapping[VariedNumber, float]) -> Recipe:
    """The recipe with other numbers; its sampled motion is still that of the former ones.

    Raises:
        RecipeError: a command does not take its number.
    """
    commands = list(recipe.commands)
    for number, value in values.items():
        entry, *path = number.path
        place = int(entry) - 1
        if place == len(commands):
            continue
        data = command_to_json(commands[place])
        inner: Any = data
        for step in path[:-1]:
            inner = inner[int(step) if isinstance(inner, list) else step]
        written = float(np.radians(value)) if _is_angle(number.path) else value
        inner[int(path[-1]) if isinstance(inner, list) else path[-1]] = written
        commands[place] = command_from_json(data, f"Entry {entry}")
    return replace(recipe, commands=tuple(commands))


def varied_values(recipe: Recipe) -> dict[str, float]:
    """The numbers that make a recipe one of a family, as they are by now."""
    paths = [tuple(one.split(".")) for one in recipe.variant.varied]
    known = _numbers(recipe, adds=False) if paths else {}
    names = _names([one for one in paths if one in known])
    return {name: known[path] for path, name in names.items()}


def values_in_words(values: Mapping[str, float]) -> str:
    """Numbers with their names and units, such as "power 4, gap 8 m"."""
    return ", ".join(_in_words(*one) for one in values.items())


def numbers_in_words(recipe: Recipe, *, adds: bool = False) -> str:
    """Numbers that can be varied, by the names to use, with what they are now."""
    known = _numbers(recipe, adds)
    units = {path: _UNIT.search(name) for path, name in _names(known).items()}
    told = [
        f"{name} {known[path]:.4g}{_UNITS[unit[1]] if (unit := units[path]) else ''}"
        for path, name in _typed(known).items()
        if not _is_place(path)
    ]
    places = [name for path, name in _typed(known).items() if _is_place(path)]
    if places:
        count = len(places)
        some = ", ".join(places[:2]) + ", ..." * (count > 2)
        told.append(f"{count} coordinate{'s' * (count > 1)} ({some})")
    return _listed(told)


def range_example(recipe: Recipe, *, adds: bool = False) -> str:
    """A range as one is typed, of the first number; empty if there is none."""
    known = _numbers(recipe, adds)
    for path, name in sorted(_typed(known).items(), key=lambda one: _is_place(one[0])):
        low, high = sorted((known[path] / 2, known[path] * 2))
        if name.endswith("seed") or low == high:
            low, high = 1, 99
        return f"{name}={low:.3g}..{high:.3g}"
    return ""


def superseded(recipe: Recipe, *, adds: bool) -> frozenset[int]:
    """Numbers of entries whose motion later entries, or traffic at the end, replace.

    Others may be, too: an edit that may depend on what agents do later keeps all before it.
    """
    found: set[int] = set()
    later: set[str] = set()
    is_all = adds
    for number, command in reversed([*enumerate(recipe.commands, start=1)]):
        if isinstance(command, ReplaceTraffic):
            ids = set(command.sample.ids)
            asked = command.request
            is_future = command.past is None and not (
                asked.resampled_state_ids or asked.removed_ids
            )
            is_future &= ids <= set(asked.agent_ids)
            if is_future and (is_all or ids <= later):
                found.add(number)
            later |= ids
            continue
        edit = command
        if isinstance(command, RegeneratedEdit):
            later.update(command.traffic.sample.ids)
            edit = command.edit
        slows = isinstance(edit, SetRoadWarp) and edit.friction_coefficient is not None
        if slows or not isinstance(edit, _OF_NO_FUTURE):
            later, is_all = set(), False
    return frozenset(found)


def added_seed(recipe: Recipe) -> _Path:
    """The seed of traffic at the end, which is no entry yet."""
    return str(len(recipe.commands) + 1), "seed"


def _in_words(name: str, value: float) -> str:
    unit = _UNIT.search(name)
    said = _UNIT.sub("", name).replace("_", " ")
    told = f"{value:.4g}" if value % 1 else f"{value:.0f}"
    return f"{said} {told}{_UNITS[unit[1]] if unit else ''}"


def _typed(known: Collection[_Path]) -> dict[_Path, str]:
    """The names to type: without units, where that means one number alone."""
    names = _names(known)
    plain = {path: _UNIT.sub("", name) for path, name in names.items()}
    count = Counter(plain.values())
    return {
        path: plain[path] if count[plain[path]] == 1 else name
        for path, name in names.items()
    }


def _listed(told: Sequence[str]) -> str:
    return ", ".join(told[:_MOST_TOLD]) + ", ..." * (len(told) > _MOST_TOLD)


def _is_place(path: _Path) -> bool:
    field = _field(path)
    return field[-1].isdigit() or field[0] in ("x_m", "y_m", "rotation_rad")


def _names(known: Collection[_Path]) -> dict[_Path, str]:
    """The shortest name of each number that means it alone."""
    short = {one: _field(one) for one in known}
    count = Counter(
        name for one in known for name in (short[one], one[:1] + short[one])
    )
    return {
        one: _shown(next((n for n in (name, one[:1] + name) if count[n] == 1), one))
        for one, name in short.items()
    }


def _shown(path: _Path) -> str:
    return ".".join(re.sub("_rad$", "_deg", one) for one in path)


def _field(path: _Path) -> _Path:
    """The last field of a path, with places in its lists."""
    return path[max(place for place, one in enumerate(path) if not one.isdigit()) :]


def _is_angle(path: _Path) -> bool:
    return _field(path)[0].endswith("_rad")


def _fitting(asked: _Path, known: Collection[_Path]) -> list[_Path]:
    """Numbers that a name means."""
    entry, rest = (asked[:1], asked[1:]) if asked[0].isdigit() else ((), asked)
    ends = {
        path: _shown(path[len(path) - len(rest) :])
        for path in known
        if path[: len(entry)] == entry
    }
    # A name with its unit means that number alone.
    return [path for path, end in ends.items() if end == ".".join(rest)] or [
        path for path, end in ends.items() if _UNIT.sub("", end) == ".".join(rest)
    ]


def _numbers(recipe: Recipe, adds: bool) -> dict[_Path, float]:
    found: dict[_Path, float] = {}

    def walk(path: _Path, value: Any) -> None:
        if is_dataclass(value):
            own = ((one.name, getattr(value, one.name)) for one in fields(value))
            inner = [one for one in own if one[0] not in _SAMPLED]
        elif isinstance(value, Mapping):
            inner = value.items()
        elif isinstance(value, tuple):
            inner = enumerate(value)
        else:
            # A truth, and a value of an enumeration, are no quantities.
            if type(value) in (int, float):
                found[path] = (
                    round(float(np.degrees(value)), 6) if _is_angle(path) else value
                )
            return
        for name, one in inner:
            walk((*path, str(name)), one)

    gone = superseded(recipe, adds=adds)
    for entry, command in enumerate(recipe.commands, start=1):
        if entry not in gone:
            walk((str(entry),), command)
    if adds:
        found[added_seed(recipe)] = 0
    return found


def _varied_by(text: str, known: Mapping[_Path, float]) -> list[VariedNumber]:
    match = _RANGE.fullmatch(text)
    try:
        name, low, high = match.groups() if match else ("", "x", "x")
        ends = float(low), float(high)
    except ValueError:
        raise RecipeError(
            f"{text[:60]!r} is no range; expected NAME=LOW..HIGH, such as power=4..8."
        ) from None
    fitting = _fitting(tuple(name.split(".")), known)
    # Chance has no meaning of its own: all of it may vary at once.
    if len(fitting) != 1 and not (fitting and name == "seed"):
        names = _typed(known)
        some = _listed([names[one] for one in sorted(fitting or known, key=_is_place)])
        what = "several numbers of this name" if fitting else "no number of this name"
        raise RecipeError(f"{name}: the edits have {what}; there are {some or 'none'}.")
    if not ends[0] <= ends[1]:
        raise RecipeError(f"{text[:60]!r} ends before it begins.")
    # A file has 6.0 for what may be a fraction.
    return [
        VariedNumber(
            path=path,
            name=name,
            low=ends[0],
            high=ends[1],
            is_whole=isinstance(known[path], int),
        )
        for path in fitting
    ]
