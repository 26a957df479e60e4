"""Makes texts from files and users safe to show in one line."""

import csv
import difflib
import io
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Final

MAX_ID_CHARACTERS: Final = 255
MAX_TEXT_CHARACTERS: Final = 8192
"""Longest text of a recipe, a journal or a scenario's field."""
_SPACES: Final = str.maketrans("\n\r\t", "   ")


def is_plain(text: str, most: int = MAX_ID_CHARACTERS) -> bool:
    """Whether a text of one line can be stored: at most ``most`` characters.

    Control characters, line breaks among them, and lone surrogates cannot.
    """
    return len(text) <= most and (
        text.isprintable()
        or not any(unicodedata.category(one) in ("Cc", "Cs") for one in text)
    )


def is_note(text: str) -> bool:
    """Whether a text can be stored that may also have line breaks and tabs."""
    return len(text) <= MAX_TEXT_CHARACTERS and (
        text.isprintable() or is_plain(text.translate(_SPACES), MAX_TEXT_CHARACTERS)
    )


def one_line(text: str, max_characters: int = 800) -> str:
    """Escape unprintable characters of a text and shorten it in the middle."""
    if not text.isprintable():
        text = "".join(
            character
            if character.isprintable()
            else character.encode("unicode_escape").decode("ascii")
            for character in text[: 4 * max_characters]
        )
    if len(text) <= max_characters:
        return text
    half = (max_characters - 5) // 2
    return f"{text[:half]} ... {text[-half:]}"


def listed(names: Sequence[str], most: int = 3) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - most} more" * (len(names) > most)
    return f"{', '.join(names[:most])}{more}"


def number_of(count: int, noun: str, none: str = "0") -> str:
    """A count with its noun, such as 1 agent, or 2 agents; ``none`` stands for 0."""
    return f"{count or none} {noun}{'s' * (count != 1)}"


def nearest_or_all(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """What a user may have meant by an unknown name, for the end of a sentence.

    Without a near name, ``otherwise`` is expected, or one of those known, of which 30 are
    listed.
    """
    names = list(dict.fromkeys(known))
    lower = {one.lower(): one for one in reversed(names)}
    near = difflib.get_close_matches(name.lower(), lower, n=1)
    if near:
        return f"the nearest is {lower[near[0]]}"
    if not names:
        return "there is none"
    return f"expected {otherwise or f'one of {listed(names, 30)}'}"


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Text in cells; bars and line breaks in it do not end a cell."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(_escaped, line))} |" for line in lines)


def csv_file(rows: Iterable[Iterable[object]], line_end: str = "\n") -> bytes:
    """A table as a CSV file in UTF-8."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator=line_end).writerows(rows)
    return text.getvalue().encode("utf-8", "replace")


def aligned(rows: Iterable[Sequence[str]], align: str = "<") -> tuple[str, ...]:
    """Lines of a table whose columns are as wide as their cells need."""
    columns = [
        [f"{one:{align}{max(map(len, column))}}" for one in column]
        for column in zip(*rows, strict=True)
    ]
    return tuple("  ".join(row).rstrip() for row in zip(*columns, strict=True))


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
