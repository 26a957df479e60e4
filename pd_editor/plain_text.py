"""Makes texts from files and users safe to show in one line."""

import difflib
from collections.abc import Iterable
from typing import Final

MAX_NAME_BYTES: Final = 255
"""Longest file name of common file systems."""
_SHOWN_CHARACTERS: Final = 800


def is_plain(text: str, max_bytes: int = MAX_NAME_BYTES) -> bool:
    """Whether a text is printable, can be encoded in UTF-8, and is not too long.

    Line breaks, NUL and lone surrogates make a text not plain.
    """
    return text.isprintable() and len(text.encode()) <= max_bytes


def one_line(text: str, max_characters: int = _SHOWN_CHARACTERS) -> str:
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


def nearest_or_all(name: str, known: Iterable[str]) -> str:
    """What a user may have meant by an unknown name, for the end of a sentence."""
    names = list(dict.fromkeys(known))
    lower = {one.lower(): one for one in reversed(names)}
    near = difflib.get_close_matches(name.lower(), lower, n=1)
    if near:
        return f"the nearest is {lower[near[0]]}"
    return f"expected one of {', '.join(names)}"
