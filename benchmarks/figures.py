"""Figures in words."""

import os
from collections.abc import Sequence

import numpy as np


def load_in_words() -> str:
    """Load of the machine, without which its times mean nothing."""
    one, five, _ = os.getloadavg()
    return f"{os.cpu_count()} cores, load {one:.1f} (1 min) {five:.1f} (5 min)"


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Median, p95, least and greatest, and how many."""
    if not len(values):
        return "none"
    low, middle, high, top = np.percentile(values, [0, 50, 95, 100])
    return (
        f"median {middle:.{digits}f}  p95 {high:.{digits}f}  "
        f"min {low:.{digits}f}  max {top:.{digits}f}  (n={len(values)})"
    )
