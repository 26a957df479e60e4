"""Recipes: a base scenario and the commands applied to it, as a JSON file."""

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import datetime, tzinfo
from typing import Any, Final

import numpy as np

from pd_editor.analysis.findings.finding import FindingKey
from pd_editor.base.errors import PdEditorError, RecipeError
from pd_editor.base.plain_text import is_note
from pd_editor.base.regular_file import json_value
from pd_editor.editor.commands import (
    Command,
    RegeneratedEdit,
    ReplaceTraffic,
    SetFocalAgent,
    SetRoadWarp,
    command_from_json,
    command_to_json,
    traffic_command,
)
from pd_editor.editor.commands.command import parts_of
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.edit_findings import edit_findings, edited_by
from pd_editor.editor.variant import Variant
from pd_editor.scene.base_reference import BaseReference
from pd_editor.scene.generation import ScenarioGenerator, run_to_end
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.scenario import Scenario

RECIPE_FORMAT: Final = "pd-editor recipe"
RECIPE_VERSION: Final = 1
MAX_RECIPE_BYTES: Final = 256 * 2**20
MAX_COMMANDS: Final = 10_000
_MAX_TIME_S: Final = 250_000_000_000.0
"""Seconds since 1970 in the last century that dates can name."""
_logger: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A reference to a base scenario, and commands in the order of application."""

    base: BaseReference
    commands: tuple[Command, ...] = ()
    created_at: str = ""
    """Date and time, ISO 8601; may be empty."""
    notes: tuple[str, ...] = ()
    """Sentences on synthetic parts of the result; a replay regenerates them."""
    variant: Variant = field(default_factory=Variant)
    """Name (scenario id of the result; empty: the base's id), tags and note."""
    caused_findings: tuple[FindingKey, ...] | None = None
    """Keys of the result's findings that edits caused; None if not looked for."""
    warps: tuple[RoadWarp, ...] = ()
    """Warps of the result's road, those of its base first, in the city frame."""
    friction_coefficient: float | None = None
    """Friction coefficient mu that the result's agents were slowed to."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """Ids of edited agents in the result's files, where its format has others."""

    def written_as(self, renamed: Mapping[str, str]) -> "Recipe":
        """The recipe of files that have other ids."""
        told = {one for _, ids, _ in self.caused_findings or () for one in ids}
        named = self.edited_ids | told
        kept = {n: renamed[n] for n in sorted(named) if renamed.get(n, n) != n}
        return replace(self, renamed=kept)

    def judged(self, scenario: Scenario, base: Scenario) -> "Recipe":
        """The recipe with the findings of its result that edits caused, and its warps."""
        found = edit_findings(scenario, base, self.commands).new
        return replace(
            self,
            caused_findings=tuple(one.key for one in found),
            warps=tuple(one.moved(scenario.origin_city_m) for one in scenario.warps),
            friction_coefficient=scenario.friction_coefficient,
        )

    @property
    def edited_ids(self) -> frozenset[str]:
        """Ids of agents that the commands, or the base's earlier edits, add or change."""
        found = set(self.base.edited_ids)
        for command in parts_of(self.commands, Command):
            if isinstance(command, ReplaceTraffic):
                found.update(command.sample.ids)
            if not isinstance(command, SetFocalAgent):
                found.update(edited_by(command))
        return frozenset(found)

    @property
    def generators(self) -> frozenset[str]:
        """Names of what generated its traffic."""
        sampled = parts_of(self.commands, ReplaceTraffic)
        return frozenset(one.generator for one in sampled)

    @property
    def is_bent(self) -> bool:
        """Whether the result's road is warped."""
        bends = parts_of(self.commands, SetRoadWarp)
        return self.base.is_bent or bool(bends and bends[-1].warp is not None)

    @property
    def result_id(self) -> str:
        """Scenario id of the result."""
        return self.variant.name or self.base.scenario_id

    def to_text(self) -> str:
        """Recipe as JSON, one command per line.

        Raises:
            RecipeError: it has more commands or bytes than are read again.
        """
        variant = to_json(self.variant)
        for name in ("is_proposed", "ignored", "parent", "varied"):
            # Of no meaning to most recipes, and unknown to earlier versions.
            if not variant[name]:
                del variant[name]
        head = {
            "format": RECIPE_FORMAT,
            "version": RECIPE_VERSION,
            "created_at": self.created_at,
            "base": to_json(self.base),
            "notes": list(self.notes),
            "variant": variant,
        }
        if self.caused_findings is not None:
            head["caused_findings"] = to_json(self.caused_findings)
        if self.warps:
            head["warps"] = to_json(self.warps)
            head["friction_coefficient"] = self.friction_coefficient
        if self.renamed:
            head["renamed"] = dict(self.renamed)
        lines = [json.dumps(command_to_json(command)) for command in self.commands]
        text = json.dumps(head, indent=1)[:-2]
        body = ",\n".join(f"  {line}" for line in lines)
        text = f'{text},\n "commands": [{chr(10) if body else ""}{body}]\n}}\n'
        self._check_limits(len(text), len(lines))
        return text

    @staticmethod
    def _check_limits(num_bytes: int, num_commands: int) -> None:
        """Raise for recipes that are too large, to be written and to be read."""
        if num_bytes > MAX_RECIPE_BYTES:
            raise RecipeError(
                f"The recipe is larger than {MAX_RECIPE_BYTES >> 20} MiB, the most that"
                " is read; undo some edits, or export after fewer."
            )
        if num_commands > MAX_COMMANDS:
            raise RecipeError(
                f"The recipe has {num_commands} commands; at most {MAX_COMMANDS} are"
                " read."
            )

    @classmethod
    def from_text(cls, text: str | bytes) -> "Recipe":
        """Read a recipe; inverse of ``to_text``.

        Raises:
            RecipeError: not a recipe, a newer version, or a bad entry.
        """
        cls._check_limits(len(text), 0)
        data = parsed_json(text, "The recipe")
        if not isinstance(data, dict) or data.get("format") != RECIPE_FORMAT:
            raise RecipeError(f'This is not a recipe; its format is "{RECIPE_FORMAT}".')
        check_version(data.get("version"), RECIPE_VERSION, "recipe")
        unknown = set(data) - {"format", "version", *(one.name for one in fields(cls))}
        if unknown:
            raise RecipeError(f"The recipe has an unknown field {min(unknown)!r}.")
        commands = data.get("commands")
        if not isinstance(commands, list):
            raise RecipeError("The recipe lacks its list of commands.")
        cls._check_limits(0, len(commands))
        notes = data.get("notes", [])
        if not isinstance(notes, list):
            raise RecipeError("The recipe's notes must be a list.")

        def read(name: str, hint: Any, default: Any = None) -> Any:
            return from_json(hint, data.get(name, default), f"The recipe's {name}")

        return cls(
            base=read("base", BaseReference),
            commands=tuple(
                command_from_json(item, f"Entry {number}")
                for number, item in enumerate(commands, start=1)
            ),
            created_at=read("created_at", str, ""),
            notes=tuple(
                note for note in notes if isinstance(note, str) and is_note(note)
            ),
            variant=variant_from_json(data.get("variant", {})),
            caused_findings=read("caused_findings", tuple[FindingKey, ...] | None),
            warps=read("warps", tuple[RoadWarp, ...], []),
            friction_coefficient=read("friction_coefficient", float | None),
            renamed=read("renamed", dict[str, str], {}),
        )


def checked_base(reference: BaseReference, base: Scenario) -> Scenario:
    """The base scenario, with the current step that its reference names.

    Raises:
        RecipeError: it is another scenario, or has other contents under the same id.
    """
    reference.check_contents(base.scenario_id, base.provenance.content_sha256)
    return base.as_referred_to(reference)


def replay(
    recipe: Recipe,
    base: Scenario,
    *,
    on_step: Callable[[int, Scenario], None] | None = None,
    allow_other_base: bool = False,
) -> Scenario:
    """Apply a recipe; ``on_step`` is called with the result of each entry.

    Raises:
        RecipeError: the base differs, or an entry does not apply.
    """
    scenario = (
        base.as_referred_to(recipe.base)
        if allow_other_base
        else checked_base(recipe.base, base)
    )
    for number, command in enumerate(recipe.commands, start=1):
        scenario = applied(command, scenario, number)
        if on_step is not None:
            on_step(number, scenario)
    return scenario


@dataclass(frozen=True, kw_only=True)
class RegeneratedEntry:
    """Comparison of a generated entry of a recipe with its regeneration."""

    number: int
    """Number of the entry in the recipe, from 1."""
    is_equal: bool
    """Whether all values are equal in float32."""
    max_difference_m: float
    """Largest distance between positions; infinity if the agents differ."""
    fresh: Command


def regenerate(
    recipe: Recipe, base: Scenario, generator: ScenarioGenerator
) -> tuple[Scenario, tuple[RegeneratedEntry, ...]]:
    """Apply a recipe, regenerate its generated traffic, and compare both.

    Raises:
        RecipeError: as ``replay``, or an entry was sampled by another generator.
        GenerationError: the generator refused.
    """
    scenario = checked_base(recipe.base, base)
    checked: list[RegeneratedEntry] = []
    for number, command in enumerate(recipe.commands, start=1):
        fresh = sampled_anew(command, scenario, lambda _name: generator, number)
        if fresh is not command:
            checked.append(_comparison(number, command, fresh))
        scenario = applied(fresh, scenario, number)
    return scenario, tuple(checked)


def sampled_anew(
    command: Command,
    scenario: Scenario,
    make: Callable[[str], ScenarioGenerator],
    number: int,
) -> Command:
    """An entry of a recipe with its traffic, if it holds any, sampled for a scenario.

    Raises:
        RecipeError: ``make`` gives another generator than it names, or its edit does not apply.
        GenerationError: the generator refused.
    """
    if isinstance(command, ReplaceTraffic):
        return _regenerated(command, scenario, make(command.generator), number)
    if isinstance(command, RegeneratedEdit):
        edited = applied(command.edit, scenario, number)
        generator = make(command.traffic.generator)
        traffic = _regenerated(command.traffic, edited, generator, number, scenario)
        return replace(command, traffic=traffic)
    return command


def regenerated(
    recipe: Recipe, base: Scenario, make: Callable[[str], ScenarioGenerator]
) -> tuple[Scenario, Recipe, tuple[RegeneratedEntry, ...]]:
    """Result and recipe with its traffic generated anew; ``make`` makes a generator.

    Raises:
        RecipeError: there is none, it is of several generators, or as ``regenerate``.
    """
    names = sorted(recipe.generators)
    if not names:
        raise RecipeError("The recipe holds no generated traffic to regenerate.")
    if len(names) > 1:
        raise RecipeError(
            f"The recipe holds traffic of {' and '.join(names)}; expected one generator to "
            "regenerate it."
        )
    scenario, entries = regenerate(recipe, base, make(*names))
    commands = list(recipe.commands)
    for entry in entries:
        commands[entry.number - 1] = entry.fresh
    return scenario, replace(recipe, commands=tuple(commands)), entries


def applied(command: Command, scenario: Scenario, number: int) -> Scenario:
    """Apply one entry of a recipe.

    Raises:
        RecipeError: the entry does not apply; the sentence names it.
    """
    try:
        return apply_within_locks(command, scenario)
    except PdEditorError as error:
        raise RecipeError(f"Entry {number} ({command.label}): {error}") from error


def variant_from_json(data: Any) -> Variant:
    """Name, tags and note of a recipe or journal.

    What cannot be read is left out and logged: edits are worth more than their note.
    """
    variant = Variant()
    for name, value in data.items() if isinstance(data, dict) else ():
        try:
            given = from_json(Variant, {name: value}, "The description")
        except RecipeError as error:
            _logger.warning("A part of the description is left out: %s", error)
            continue
        variant = replace(variant, **{name: getattr(given, name)})
    return variant


def moment(time_s: float, zone: tzinfo | None = None) -> datetime:
    """Date of seconds since 1970; what is beyond all dates becomes a far one."""
    return datetime.fromtimestamp(max(-_MAX_TIME_S / 5, min(time_s, _MAX_TIME_S)), zone)


def parsed_json(text: str | bytes, what: str) -> Any:
    """Parse a JSON text.

    Raises:
        RecipeError: the text is not JSON.
    """
    try:
        return json_value(text)
    except ValueError as error:
        raise RecipeError(f"{what} is not valid JSON.") from error


def check_version(version: Any, known: int, what: str) -> None:
    """Raise for newer formats, and for a missing version."""
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise RecipeError(f"The {what} names no version.")
    if version > known:
        raise RecipeError(
            f"The {what} is of version {version}; this program reads up to {known}."
        )


def _regenerated(
    command: ReplaceTraffic,
    scenario: Scenario,
    generator: ScenarioGenerator,
    number: int,
    before_edit: Scenario | None = None,
) -> ReplaceTraffic:
    request = command.request.request(scenario, command.seed)
    request = replace(request, before_edit=before_edit)
    others = RecipeError(
        f"Entry {number} was sampled by {command.generator}, not by {generator.name}."
    )
    # The folder of a model may have been renamed: its weights tell which it is.
    is_named_so = generator.name == command.generator
    if not is_named_so and not command.model_sha256:
        raise others
    traffic = run_to_end(generator.generate(request))
    if not is_named_so and traffic.model_sha256 != command.model_sha256:
        raise others
    return traffic_command(
        request,
        traffic,
        command.request.sample_index,
        removed_ids=command.request.removed_ids,
    )


def _comparison(number: int, stored: Command, fresh: Command) -> RegeneratedEntry:
    (ours,), (theirs,) = (
        [part.sample for part in parts_of([one], ReplaceTraffic)]
        for one in (stored, fresh)
    )
    if ours.ids != theirs.ids or ours.position_m.shape != theirs.position_m.shape:
        return RegeneratedEntry(
            number=number, is_equal=False, max_difference_m=float("inf"), fresh=fresh
        )
    gap = np.linalg.norm(ours.position_m - theirs.position_m, axis=-1)
    return RegeneratedEntry(
        number=number,
        is_equal=to_json(ours) == to_json(theirs),
        max_difference_m=float(gap.max(initial=0.0)),
        fresh=fresh,
    )


def is_recipe(content: bytes) -> bool:
    """Whether a file begins as recipes do, whatever its name is."""
    # The format is the first of a recipe's fields.
    return f'"{RECIPE_FORMAT}"'.encode() in content[:200]
