"""What a generation has to say at the moment."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class RunState:
    """One under way, or a result that waits."""

    text: str = ""
    """A few words; empty where the problems should be told as ever."""
    fraction: float | None = None
    """How much is done; None when nothing runs."""
    action: str = ""
    """Text of a button that uses a result that waits."""
