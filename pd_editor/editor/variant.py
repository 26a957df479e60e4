"""Name, tags and note of an edited scenario, and what its user ignores."""

import re
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from pd_editor.analysis.findings.finding import IgnoredKey
from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import is_note, is_plain
from pd_editor.editor.commands.command import Command, parts_of
from pd_editor.editor.commands.road import SetRoadWarp
from pd_editor.editor.commands.roll_out import BeginAt, ContinueScene
from pd_editor.editor.commands.traffic import ReplaceTraffic
from pd_editor.scene.scenario import Scenario

MAX_NAME_CHARACTERS: Final = 80
MAX_TAGS: Final = 20
MAX_TAG_CHARACTERS: Final = 60
MAX_NOTE_CHARACTERS: Final = 4000
SHORT_ID_CHARACTERS: Final = 40
# Path.stem cuts folder names at a dot, so names have none.
_NAME: Final = re.compile(rf"[A-Za-z0-9][A-Za-z0-9_-]{{0,{MAX_NAME_CHARACTERS - 1}}}")
_UUID: Final = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


@dataclass(frozen=True, kw_only=True)
class Variant:
    """Name, tags and note of an edited scenario, and what its user ignores."""

    name: str = ""
    """Id of the exported scenario: letters, digits, hyphens and underscores. Empty: proposed."""
    tags: tuple[str, ...] = ()
    note: str = ""
    is_proposed: bool = False
    """Whether the program chose a name of another kind than ``proposed_name`` for a
    result; it holds until the next edit."""
    ignored: tuple[IgnoredKey, ...] = ()
    """Findings that do not count."""
    parent: str = ""
    """Name of the scenario whose family it is of; empty: of none."""
    varied: tuple[str, ...] = ()
    """Paths in the recipe, from the number of the entry, of the numbers that make it."""

    def __post_init__(self) -> None:
        if self.name and _NAME.fullmatch(self.name) is None:
            raise EditError(
                f"The name {self.name[:60]!r} does not fit; expected up to"
                f" {MAX_NAME_CHARACTERS} letters, digits, hyphens and underscores."
            )
        if len(self.tags) > MAX_TAGS or any(
            not (tag and is_plain(tag, MAX_TAG_CHARACTERS)) for tag in self.tags
        ):
            raise EditError(
                f"Expected up to {MAX_TAGS} tags of up to {MAX_TAG_CHARACTERS}"
                " characters each, without control characters."
            )
        if len(self.note) > MAX_NOTE_CHARACTERS:
            raise EditError(
                f"The note has {len(self.note)} characters; at most"
                f" {MAX_NOTE_CHARACTERS} are kept."
            )
        if not is_note(self.note):
            raise EditError("The note has control characters; expected plain text.")

    def tagged(
        self, given: Sequence[str], taken: Sequence[str] = (), note: str | None = None
    ) -> "Variant":
        """With more tags, without others, and with another note if one is given.

        Raises:
            EditError: a tag or the note does not fit.
        """
        tags = dict.fromkeys((*self.tags, *given))
        return replace(
            self,
            tags=tuple(one for one in tags if one not in taken),
            note=self.note if note is None else note,
        )

    def of_result(self) -> "Variant":
        """Tags, note and ignored findings of the result, which has no edits."""
        ignored = tuple((kind, ids, about, "") for kind, ids, about, _ in self.ignored)
        return Variant(tags=self.tags, note=self.note, ignored=ignored)


@dataclass(frozen=True, kw_only=True)
class ExportMark:
    """That a state of a session was exported, or is kept in the library."""

    name: str
    saved_at: float | None = None
    """Time of saving, which tells cards of one name apart; None if exported."""


def name_from_text(text: str) -> str:
    """Convert a user's text to a name, with hyphens for characters that are not allowed."""
    # Letters with accents become those without.
    plain = re.sub(r"[\u0300-\u036f]", "", unicodedata.normalize("NFKD", text))
    words = re.findall(r"[A-Za-z0-9_]+", plain)
    return "-".join(words)[:MAX_NAME_CHARACTERS].strip("-_")


def fit_name(scenario_id: str) -> str:
    """An id as it is if it is a name, or a name that is like it."""
    if _NAME.fullmatch(scenario_id):
        return scenario_id
    return name_from_text(scenario_id) or "scenario"


def tags_from_text(*texts: str) -> tuple[str, ...]:
    """Split texts into tags at commas, without duplicates."""
    words = (" ".join(part.split()) for text in texts for part in text.split(","))
    return tuple(dict.fromkeys(word for word in words if word))


def proposed_name(base_id: str, commands: Sequence[Command], scenario: Scenario) -> str:
    """Name that describes the edits, such as ``000c4929-double-turn-p6-s3``.

    Their number is told if road, traffic and time do not say all. Empty without
    commands: the scenario keeps the base's id.
    """
    if not commands:
        return ""
    parts = [short_id(base_id)]
    applied = scenario.applied_warp
    terms = () if applied is None else applied.warp.terms
    parts += [f"{term.kind}-{power_name(term.power)}" for term in terms]
    done = parts_of(commands, Command)
    if generated := parts_of(commands, ReplaceTraffic):
        parts.append(f"s{generated[-1].seed}")
    for one in done:
        if isinstance(one, BeginAt):
            parts.append(f"from-{power_name(one.time_s).lstrip('p')}s")
        elif isinstance(one, ContinueScene):
            driven = dict.fromkeys(one.policies.values())
            parts += ["rolled-out", *driven, f"s{one.seed}"]
    told = SetRoadWarp | ReplaceTraffic | BeginAt | ContinueScene
    if not all(isinstance(one, told) for one in done):
        count = len(commands)
        parts.append(f"{count}-edit{'s' if count > 1 else ''}")
    if len(parts) == 1:
        parts.append("edited")
    return name_from_text(" ".join(parts))


def free_name(name: str, is_taken: Callable[[str], bool]) -> str:
    """First unused name of ``name``, ``name-2``, ``name-3``, ..."""
    found, number = name, 1
    while is_taken(found):
        number += 1
        ending = f"-{number}"
        found = name[: MAX_NAME_CHARACTERS - len(ending)].rstrip("-_") + ending
    return found


def short_id(scenario_id: str) -> str:
    """First part of a UUID; other ids up to a readable length."""
    if _UUID.fullmatch(scenario_id):
        return scenario_id[:8]
    return scenario_id[:SHORT_ID_CHARACTERS]


def power_name(power: float) -> str:
    """Name of a power with its sign, such as ``p6`` and ``m2-5``."""
    sign = "p" if power >= 0 else "m"
    return f"{sign}{abs(power):g}".replace(".", "-")
