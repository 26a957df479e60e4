"""Confidence intervals, by drawing scenes anew.

Agents of one scene are alike, so scenes are drawn, never agents.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.metrics.values import MetricValues

NUM_DRAWS: Final = 2000
LEVEL: Final = 0.95


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean over the values of all scenes, and between what it likely lies."""

    mean: float
    low: float
    high: float
    num_scenes: int
    """Scenes with a valid value."""
    num_values: int
    is_valid: bool
    """False where there is no value; the numbers are 0 then."""


def mean_interval(
    scenes: Sequence[MetricValues],
    *,
    draws: int = NUM_DRAWS,
    level: float = LEVEL,
    seed: int = 0,
) -> Interval:
    """Mean of the valid values of all scenes together, every value weighing the same."""
    total = np.array([scene.value.sum() for scene in scenes], float)
    count = np.array([scene.is_valid.sum() for scene in scenes], float)
    return _interval(total, count, draws, level, seed)


def difference_interval(
    first: Sequence[MetricValues],
    second: Sequence[MetricValues],
    *,
    draws: int = NUM_DRAWS,
    level: float = LEVEL,
    seed: int = 0,
) -> Interval:
    """Mean of first minus second, over the agents for whom both say something.

    Scene by scene, both must have the same agents in the same rows.
    """
    total, count = np.zeros(len(first)), np.zeros(len(first))
    for index, (one, two) in enumerate(zip(first, second, strict=True)):
        assert one.value.shape == two.value.shape
        both = one.is_valid & two.is_valid
        total[index] = (one.value - two.value)[both].sum()
        count[index] = both.sum()
    return _interval(total, count, draws, level, seed)


def _interval(
    total: Float[np.ndarray, "S"],
    count: Float[np.ndarray, "S"],
    draws: int,
    level: float,
    seed: int,
) -> Interval:
    total, count = total[count > 0], count[count > 0]
    num_scenes = len(total)
    if not num_scenes:
        return Interval(
            mean=0.0, low=0.0, high=0.0, num_scenes=0, num_values=0, is_valid=False
        )
    random = np.random.default_rng(seed)
    drawn = random.integers(num_scenes, size=(draws, num_scenes))
    means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    return Interval(
        mean=float(total.sum() / count.sum()),
        low=float(low),
        high=float(high),
        num_scenes=num_scenes,
        num_values=int(count.sum()),
        is_valid=True,
    )
