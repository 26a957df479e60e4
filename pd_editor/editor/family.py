"""A family: one recipe many times, with other numbers in its commands.

A recipe that generates no traffic, or none since guidance was set, gets traffic of
everybody at its end, so that each variant shows what its numbers do.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import ContinueScene, traffic_command
from pd_editor.editor.edit_findings import unrun_terms
from pd_editor.editor.recipe import Recipe, applied, regenerated, replay
from pd_editor.editor.scenario_store import exported_files
from pd_editor.editor.varied_numbers import (
    VariedNumber,
    added_seed,
    superseded,
    varied,
)
from pd_editor.scene.generation import (
    GenerationRequest,
    ScenarioGenerator,
    run_to_end,
)
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
    Traffic that is replaced later is not made.

    Raises:
        RecipeError: a command does not take its number, or does not apply.
        GenerationError: the generator refused.
    """
    gone = superseded(recipe, adds=adds)
    variant = replace(
        recipe.variant,
        name=name,
        parent=recipe.result_id,
        varied=tuple(_without(one.path, gone) for one in values),
    )
    commands = enumerate(varied(recipe, values).commands, start=1)
    fresh = replace(
        recipe,
        variant=variant,
        commands=tuple(one for number, one in commands if number not in gone),
    )
    if fresh.generators:
        scenario, fresh, _ = regenerated(fresh, opened, make)
    else:
        scenario = replay(fresh, opened)
    if adds:
        seeds = {one.path: int(value) for one, value in values.items()}
        request = GenerationRequest(
            scenario=scenario,
            agent_ids=drivable_agent_ids(scenario),
            seed=seeds.get(added_seed(recipe), 0),
        )
        generator = make(next(iter(recipe.generators), ""))
        command = traffic_command(request, run_to_end(generator.generate(request)))
        fresh = replace(fresh, commands=(*fresh.commands, command))
        scenario = applied(command, scenario, len(fresh.commands))
    return Member(
        scenario=scenario,
        base=opened.as_referred_to(recipe.base),
        recipe=fresh,
    )


def values_of(values: Mapping[VariedNumber, float]) -> dict[str, float]:
    """Numbers of a variant by their names."""
    return {one.name: value for one, value in values.items()}


def _without(path: tuple[str, ...], gone: Collection[int]) -> str:
    """A path in the recipe from which entries are gone."""
    entry = int(path[0])
    return ".".join((str(entry - sum(one < entry for one in gone)), *path[1:]))
