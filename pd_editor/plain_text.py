"""Makes texts from files and users safe to show in one line."""

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
