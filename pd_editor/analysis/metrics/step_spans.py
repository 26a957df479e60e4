"""Intervals of steps at which something holds."""

from typing import Final

import numpy as np
from jaxtyping import Int

_GAP_STEPS: Final = 2
"""Spans at most this far apart are joined."""

Spans = tuple[tuple[int, int], ...]
"""First and last steps of intervals, in order."""


def spans_of(steps: Int[np.ndarray, "N"]) -> Spans:
    """First and last steps of the runs in increasing steps; short gaps are closed."""
    breaks = np.flatnonzero(np.diff(steps) > _GAP_STEPS)
    first = steps[np.concatenate([[0], breaks + 1])]
    last = steps[np.concatenate([breaks, [len(steps) - 1]])]
    return tuple(zip(first.tolist(), last.tolist(), strict=True))


def holds_at(spans: Spans, step: float) -> bool:
    """Whether a step is in one of the intervals; half steps are rounded."""
    nearest = round(step)
    return any(first <= nearest <= last for first, last in spans)
