"""Conditions on what happens in scenes that are offered as buttons."""

import re
from typing import Final

COMMON: Final = (
    "cut-in",
    "lane-change",
    "left-turn",
    "right-turn",
    "hard-braking",
    "yielding",
    "crossing with pedestrian",
    "near-miss",
    "overtaking",
    "merge",
)


def toggled(query: str, condition: str) -> str:
    """A query with one more condition, or without it where it has it."""
    query = re.sub(r"(\s+(and|or))+$", "", query.strip(), flags=re.IGNORECASE)
    parts = re.split(r"\s+and\s+", query, flags=re.IGNORECASE) if query else []
    if condition in parts:
        parts.remove(condition)
    elif re.search(r"\bor\b", query, re.IGNORECASE):
        parts = [f"({query})", condition]
    else:
        parts.append(condition)
    return " and ".join(parts)
