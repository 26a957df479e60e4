"""State of a generation for the page."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class RunState:
    """State of a running generation, or of a waiting result."""

    text: str = ""
    """Short text; empty to show problems instead."""
    fraction: float | None = None
    """Fraction that is done; None without a running generation."""
    action: str = ""
    """Label of a button that applies a waiting result."""
