"""A family: one recipe many times, with other numbers in its commands.

A recipe that generates no traffic, or none since guidance was set, gets traffic of
everybody at its end, so that each variant shows what its numbers do.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import RecipeError
from pd_editor.base.installed_files import DEMO_PREFIX
from pd_editor.base.plain_text import number_of
from pd_editor.editor.carried_edits import carried
from pd_editor.editor.commands import (
    Command,
    ContinueScene,
    ReplaceTraffic,
    SetRoadWarp,
    traffic_command,
)
from pd_editor.editor.commands.command import parts_of
from pd_editor.editor.edit_findings import unrun_terms
from pd_editor.editor.recipe import Recipe, applied, regenerated, replay
from pd_editor.editor.scenario_store import exported_files, open_scenario
from pd_editor.editor.variant import fit_name, free_name, power_name, short_id
from pd_editor.editor.varied_numbers import (
    VariedNumber,
    added_seed,
    superseded,
    values_in_words,
    varied,
)
from pd_editor.scene.generation import GenerationRequest, ScenarioGenerator, run_to_end
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

MOST_MEMBERS: Final = 10_000


def adds_traffic(recipe: Recipe, result: Scenario) -> bool:
    """Whether variants get traffic at their end; ``result`` is what the recipe makes."""
    goes_on = any(isinstance(one, ContinueScene) for one in recipe.commands)
    is_generated = bool(recipe.generators) or goes_on
    return not is_generated or bool(unrun_terms(result, recipe.commands))


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
        yield {one: one.at(part) for one, part in zip(numbers, own, strict=True)}


@dataclass(frozen=True, kw_only=True)
class Member:
    """A variant of a family."""

    scenario: Scenario
    base: Scenario
    recipe: Recipe
    left_out: tuple[str, ...] = ()
    """Edits that mean nothing in another scene than their own."""

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
    on: Scenario | None = None,
) -> Member:
    """Make a variant with some numbers; ``make`` makes the generator of its traffic.

    Of ``adds_traffic`` the generator is that of the recipe, or the one without a name.
    Traffic that is replaced later is not made. ``on`` is another scene to make it in.

    Raises:
        RecipeError: a command does not take its number, or does not apply.
        GenerationError: the generator refused.
        EditError: the other scene has no focal agent to warp the road ahead of.
    """
    # Elsewhere an edit that replaces another one may be left out.
    gone = frozenset[int]() if on is not None else superseded(recipe, adds=adds)
    commands: Mapping[int, Command] = {
        number: command
        for number, command in enumerate(varied(recipe, values).commands, start=1)
        if number not in gone
    }
    fresh = replace(recipe, commands=tuple(commands.values()))
    left_out: tuple[str, ...] = ()
    if on is not None:
        scenario, made = carried(commands, _befores(recipe, opened), on, make)
        gone = commands.keys() - made.keys()
        left_out = tuple(commands[one].label for one in sorted(gone))
        opened, fresh = on, replace(fresh, commands=tuple(made.values()))
        fresh = replace(fresh, base=on.reference, notes=scenario.provenance.notes)
    elif fresh.generators:
        scenario, fresh, _ = regenerated(fresh, opened, make)
    else:
        scenario = replay(fresh, opened)
    kept = [one.path for one in values if int(one.path[0]) not in gone]
    variant = replace(
        recipe.variant,
        name=name,
        parent=recipe.result_id,
        varied=tuple(_without(path, gone) for path in kept),
    )
    fresh = replace(fresh, variant=variant)
    if adds:
        seeds = {one.path: int(value) for one, value in values.items()}
        seed = seeds.get(added_seed(recipe), 0)
        generator = make(next(iter(recipe.generators), ""))
        command = _traffic(scenario, generator, seed)
        fresh = replace(fresh, commands=(*fresh.commands, command))
        scenario = applied(command, scenario, len(fresh.commands))
    return Member(
        scenario=scenario,
        base=opened.as_referred_to(fresh.base),
        recipe=fresh,
        left_out=left_out,
    )


def _traffic(
    scenario: Scenario, generator: ScenarioGenerator, seed: int
) -> ReplaceTraffic:
    """New trajectories of everybody."""
    request = GenerationRequest(
        scenario=scenario, agent_ids=drivable_agent_ids(scenario), seed=seed
    )
    return traffic_command(request, run_to_end(generator.generate(request)))


def _befores(recipe: Recipe, opened: Scenario) -> dict[int, Scenario]:
    """The scenario before each entry."""
    states = {1: opened.as_referred_to(recipe.base)}
    replay(recipe, opened, on_step=lambda number, one: states.update({number + 1: one}))
    return states


@dataclass(frozen=True, kw_only=True)
class MemberPlan:
    """A variant to be made: its name, its numbers, and the other scene if it is of one."""

    name: str
    values: Mapping[VariedNumber, float]
    on: str = ""

    @property
    def in_words(self) -> str:
        """Name, scene and numbers."""
        told = [self.on, values_in_words(values_of(self.values))]
        return f"{self.name} ({', '.join(filter(None, told))})"

    def made(
        self,
        recipe: Recipe,
        opened: Scenario,
        make: Callable[[str], ScenarioGenerator],
        *,
        adds: bool,
    ) -> Member:
        """The variant; raises as ``member``, and InputError for a scene it cannot read."""
        on = open_scenario(self.on) if self.on else None
        return member(recipe, opened, self.values, self.name, make, adds=adds, on=on)


def planned(
    name: str,
    values: Sequence[Mapping[VariedNumber, float]],
    on: Sequence[str] = (),
    is_taken: Callable[[str], bool] = lambda _name: False,
) -> tuple[MemberPlan, ...]:
    """Variants with all values in each of some scenes, or in the recipe's own."""
    plans: dict[str, MemberPlan] = {}
    for scene in on or ("",):
        base = short_id(Path(scene).name.removeprefix(DEMO_PREFIX))
        of = fit_name(f"{name}-on-{base}") if scene else name
        for number, own in enumerate(values, start=1):
            number_name = f"-{number:0{len(str(len(values)))}d}"
            said = of if scene and len(values) == 1 else of + number_name
            said = free_name(said, lambda one: one in plans or is_taken(one))
            plans[said] = MemberPlan(name=said, values=own, on=scene)
    return tuple(plans.values())


def family_name(recipe: Recipe, numbers: Iterable[VariedNumber]) -> str:
    """Name of a recipe without what it tells of numbers that vary."""
    name, varied = recipe.result_id, {one.path[-1] for one in numbers}
    for edit in parts_of(recipe.commands, SetRoadWarp):
        for term in edit.warp.terms if edit.warp and "power" in varied else ():
            name = name.replace(f"{term.kind}-{power_name(term.power)}", term.kind)
    for run in parts_of(recipe.commands, ReplaceTraffic) if "seed" in varied else ():
        name = re.sub(rf"-s{run.seed}(?=-|$)", "", name)
    return name


def left_out_in_words(made: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
    """Which edits were left out in variants, with the number of these."""
    count = Counter(chain.from_iterable(made))
    return tuple(
        f"Left out of {number_of(times, 'variant')}, for it is of its own scene: {label}."
        for label, times in count.items()
    )


def values_of(values: Mapping[VariedNumber, float]) -> dict[str, float]:
    """Numbers of a variant by their names."""
    return {one.name: value for one, value in values.items()}


def _without(path: tuple[str, ...], gone: Collection[int]) -> str:
    """A path in the recipe from which entries are gone."""
    entry = int(path[0])
    return ".".join((str(entry - sum(one < entry for one in gone)), *path[1:]))
