"""A family: one recipe many times, with other numbers in its commands."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import command_from_json, command_to_json
from pd_editor.editor.recipe import Recipe

MOST_MEMBERS: Final = 10_000
_RANGE: Final = re.compile(r"([\w.-]+)=([-+\d.eE]+?)\.\.([-+\d.eE]+)")
_SAMPLED: Final = ("sample", "past")
"""Fields of motion, which is sampled anew and not varied."""
_Path = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class VariedNumber:
    """A number of a recipe's commands, and the range that it is varied over."""

    path: _Path
    """Number of the entry from 1, then fields and places in lists, as the recipe has them."""
    low: float
    high: float
    is_whole: bool

    @property
    def name(self) -> str:
        """The field's name, for tables."""
        return (
            self.path[-1] if not self.path[-1].isdigit() else ".".join(self.path[-2:])
        )


def varied_numbers(recipe: Recipe, texts: Sequence[str]) -> tuple[VariedNumber, ...]:
    """Read ranges such as ``power=4..8``, ``2.seed=1..99`` or ``point_m.0=-45..-35``.

    Raises:
        RecipeError: a text is no range, or names no number or several.
    """
    known = _numbers(recipe)
    return tuple(_varied_number(text, known) for text in texts)


def members(
    numbers: Sequence[VariedNumber], count: int, seed: int
) -> Iterator[dict[VariedNumber, float]]:
    """Values of each member of a family: a Latin hypercube over the ranges.

    Each range is cut into as many equal parts as there are members; each part is used once.

    Raises:
        RecipeError: there are no or too many members.
    """
    if not 1 <= count <= MOST_MEMBERS:
        raise RecipeError(f"A family has 1 to {MOST_MEMBERS} members, not {count}.")
    random = np.random.default_rng(seed)
    order = random.permuted(np.tile(np.arange(count), (len(numbers), 1)), axis=1)
    share = (order + random.random(order.shape)) / count
    for own in share.T:
        yield {one: _at(one, part) for one, part in zip(numbers, own, strict=True)}


def varied(recipe: Recipe, values: Mapping[VariedNumber, float]) -> Recipe:
    """The recipe with other numbers; its sampled motion is still that of the former ones.

    Raises:
        RecipeError: a command does not take its number.
    """
    commands = list(recipe.commands)
    for number, value in values.items():
        entry, *path = number.path
        place = int(entry) - 1
        data = command_to_json(commands[place])
        inner: Any = data
        for step in path[:-1]:
            inner = inner[int(step) if isinstance(inner, list) else step]
        inner[int(path[-1]) if isinstance(inner, list) else path[-1]] = value
        commands[place] = command_from_json(data, f"Entry {entry}")
    return replace(recipe, commands=tuple(commands))


def _numbers(recipe: Recipe) -> dict[_Path, float]:
    found: dict[_Path, float] = {}

    def walk(path: _Path, value: Any) -> None:
        if isinstance(value, dict) and "zlib" not in value:
            for name, inner in value.items():
                if name not in _SAMPLED:
                    walk((*path, name), inner)
        elif isinstance(value, list):
            for place, inner in enumerate(value):
                walk((*path, str(place)), inner)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found[path] = value

    for entry, command in enumerate(recipe.commands, start=1):
        walk((str(entry),), command_to_json(command))
    return found


def _varied_number(text: str, known: Mapping[_Path, float]) -> VariedNumber:
    match = _RANGE.fullmatch(text)
    try:
        name, low, high = match.groups() if match else ("", "x", "x")
        ends = float(low), float(high)
    except ValueError:
        raise RecipeError(
            f"{text[:60]!r} is no range; expected NAME=LOW..HIGH, such as power=4..8."
        ) from None
    asked = tuple(name.split("."))
    entry, fields = (asked[:1], asked[1:]) if asked[0].isdigit() else ((), asked)
    fitting = [
        path
        for path in known
        if path[: len(entry)] == entry and path[len(path) - len(fields) :] == fields
    ]
    if len(fitting) != 1:
        named = [".".join(one) for one in fitting or known]
        some = ", ".join(named[:12]) + ", ..." * (len(named) > 12)
        what = "several numbers of this name" if fitting else "no number of this name"
        raise RecipeError(f"{name}: the recipe has {what}; there are {some or 'none'}.")
    if not ends[0] <= ends[1]:
        raise RecipeError(f"{text[:60]!r} ends before it begins.")
    (path,) = fitting
    # A file has 6.0 for what may be a fraction.
    is_whole = isinstance(known[path], int)
    return VariedNumber(path=path, low=ends[0], high=ends[1], is_whole=is_whole)


def _at(number: VariedNumber, share: float) -> float:
    if number.is_whole:
        low, high = round(number.low), round(number.high)
        return min(low + int(share * (high - low + 1)), high)
    return round(number.low + share * (number.high - number.low), 6)
