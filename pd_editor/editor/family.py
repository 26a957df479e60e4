"""A family: one recipe many times, with other numbers in its commands.

A recipe that generates no traffic, or none since guidance was set, gets traffic of
everybody at its end, so that each variant shows what its numbers do.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import (
    ContinueScene,
    ReplaceTraffic,
    command_from_json,
    command_to_json,
    traffic_command,
)
from pd_editor.editor.edit_findings import unrun_terms
from pd_editor.editor.recipe import Recipe, applied, regenerated, replay
from pd_editor.editor.scenario_store import exported_files
from pd_editor.scene.generation import (
    GenerationRequest,
    ScenarioGenerator,
    run_to_end,
)
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

MOST_MEMBERS: Final = 10_000
_RANGE: Final = re.compile(r"([\w.-]+)=([-+\d.eE]+?)\.\.([-+\d.eE]+)")
_MOST_TOLD: Final = 24
_SAMPLED: Final = ("sample", "past", "num_samples", "sample_index")
"""Fields of motion, which is sampled anew and not varied, and of which sample it is."""
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
        return ".".join(_field(self.path))


def adds_traffic(recipe: Recipe, result: Scenario) -> bool:
    """Whether variants get traffic at their end; ``result`` is what the recipe makes."""
    goes_on = any(isinstance(one, ContinueScene) for one in recipe.commands)
    is_generated = bool(recipe.generators) or goes_on
    return not is_generated or bool(unrun_terms(result, recipe.commands))


def varied_numbers(
    recipe: Recipe, texts: Sequence[str], *, adds: bool = False
) -> tuple[VariedNumber, ...]:
    """Read ranges such as ``power=4..8``, ``2.seed=1..99`` or ``point_m.0=-45..-35``.

    With ``adds``, ``seed`` may be that of the traffic that variants get at their end.

    Raises:
        RecipeError: there is no text, or one is no range, names no number or several, or
            one that is named already.
    """
    known = _numbers(recipe, adds)
    found = {one.path: one for one in (_varied_number(text, known) for text in texts)}
    if not texts:
        raise RecipeError("A family needs a range, such as power=4..8.")
    if len(found) < len(texts):
        raise RecipeError("Two ranges are of the same number; expected one for each.")
    return tuple(found.values())


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
        if place == len(commands):
            continue
        data = command_to_json(commands[place])
        inner: Any = data
        for step in path[:-1]:
            inner = inner[int(step) if isinstance(inner, list) else step]
        inner[int(path[-1]) if isinstance(inner, list) else path[-1]] = value
        commands[place] = command_from_json(data, f"Entry {entry}")
    return replace(recipe, commands=tuple(commands))


@dataclass(frozen=True, kw_only=True)
class Member:
    """A variant of a family."""

    scenario: Scenario
    base: Scenario
    recipe: Recipe
    values: Mapping[VariedNumber, float]

    @property
    def files(self) -> dict[str, bytes]:
        """Files of its export."""
        return exported_files(self.scenario, self.recipe, self.base)


def member(
    recipe: Recipe,
    opened: Scenario,
    values: Mapping[VariedNumber, float],
    name: str,
    make: Callable[[str], ScenarioGenerator],
    *,
    adds: bool = False,
) -> Member:
    """Make a variant with some numbers; ``make`` makes the generator of its traffic.

    Of ``adds_traffic`` the generator is that of the recipe, or the one without a name.

    Raises:
        RecipeError: a command does not take its number, or does not apply.
        GenerationError: the generator refused.
    """
    told = in_words(values)
    variant = replace(recipe.variant, name=name, note=told)
    fresh = replace(varied(recipe, values), variant=variant)
    if fresh.generators:
        scenario, fresh, _ = regenerated(fresh, opened, make)
    else:
        scenario = replay(fresh, opened)
    if adds:
        command = _traffic(fresh, scenario, make, values)
        fresh = replace(fresh, commands=(*fresh.commands, command))
        scenario = applied(command, scenario, len(fresh.commands))
    return Member(
        scenario=scenario,
        base=opened.as_referred_to(recipe.base),
        recipe=fresh,
        values=values,
    )


def _traffic(
    recipe: Recipe,
    scenario: Scenario,
    make: Callable[[str], ScenarioGenerator],
    values: Mapping[VariedNumber, float],
) -> ReplaceTraffic:
    """New trajectories of everybody."""
    seeds = {one.path: int(value) for one, value in values.items()}
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=drivable_agent_ids(scenario),
        seed=seeds.get(_added_seed(recipe), 0),
    )
    generator = make(next(iter(recipe.generators), ""))
    return traffic_command(request, run_to_end(generator.generate(request)))


def in_words(values: Mapping[VariedNumber, float]) -> str:
    """Numbers of a variant by their names."""
    return ", ".join(f"{one.name} {value:g}" for one, value in values.items())


def numbers_in_words(recipe: Recipe, *, adds: bool = False) -> str:
    """Numbers that can be varied, by the names to use, with what they are now."""
    known = _numbers(recipe, adds)
    names = _names(known)
    some = [f"{names[path]} {known[path]:.4g}" for path in list(known)[:_MOST_TOLD]]
    return ", ".join(some) + ", ..." * (len(known) > _MOST_TOLD)


def _names(known: Collection[_Path]) -> dict[_Path, str]:
    """The shortest name of each number that means it alone."""
    short = {one: _field(one) for one in known}
    count = Counter(
        name for one in known for name in (short[one], one[:1] + short[one])
    )
    return {
        one: ".".join(next((n for n in (name, one[:1] + name) if count[n] == 1), one))
        for one, name in short.items()
    }


def _field(path: _Path) -> _Path:
    """The last field of a path, with places in its lists."""
    return path[max(place for place, one in enumerate(path) if not one.isdigit()) :]


def _fitting(asked: _Path, known: Collection[_Path]) -> list[_Path]:
    """Numbers that a name means."""
    entry, rest = (asked[:1], asked[1:]) if asked[0].isdigit() else ((), asked)
    return [
        path
        for path in known
        if path[: len(entry)] == entry and path[len(path) - len(rest) :] == rest
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
                found[path] = value
            return
        for name, one in inner:
            walk((*path, str(name)), one)

    for entry, command in enumerate(recipe.commands, start=1):
        walk((str(entry),), command)
    if adds:
        found[_added_seed(recipe)] = 0
    return found


def _added_seed(recipe: Recipe) -> _Path:
    """The seed of traffic at the end, which is no entry yet."""
    return str(len(recipe.commands) + 1), "seed"


def _varied_number(text: str, known: Mapping[_Path, float]) -> VariedNumber:
    match = _RANGE.fullmatch(text)
    try:
        name, low, high = match.groups() if match else ("", "x", "x")
        ends = float(low), float(high)
    except ValueError:
        raise RecipeError(
            f"{text[:60]!r} is no range; expected NAME=LOW..HIGH, such as power=4..8."
        ) from None
    fitting = _fitting(tuple(name.split(".")), known)
    if len(fitting) != 1:
        names = _names(known)
        named = [names[one] for one in fitting or known]
        some = ", ".join(named[:_MOST_TOLD]) + ", ..." * (len(named) > _MOST_TOLD)
        what = "several numbers of this name" if fitting else "no number of this name"
        raise RecipeError(f"{name}: the edits have {what}; there are {some or 'none'}.")
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
