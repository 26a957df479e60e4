"""Ratios of sums over scenes, with percentile intervals by resampling scenes."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.report import NONE

NUM_RESAMPLES: Final = 1000
COVERAGE: Final = 0.95


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Means and intervals of many cells; NaN if a cell has fewer than two scenes."""

    value: Float[np.ndarray, "*cells"]
    low: Float[np.ndarray, "*cells"]
    high: Float[np.ndarray, "*cells"]

    def cell(
        self,
        at: tuple[int, ...],
        unit: str,
        *,
        signed: bool = False,
        with_interval: bool = True,
    ) -> str:
        """Text of a mean with its interval; shares in per cent."""
        scale = 100.0 if unit == "share" else 1.0
        numbers = [scale * float(one[at]) for one in (self.value, self.low, self.high)]
        if np.isnan(numbers[0]):
            return NONE
        digits = 1 if unit == "share" else 2
        texts = [f"{number:{'+' if signed else ''}.{digits}f}" for number in numbers]
        if not with_interval or np.isnan(numbers[1]):
            return texts[0]
        return f"{texts[0]} [{texts[1]}, {texts[2]}]"


def scene_weights(num_scenes: int, seed: int) -> Float[np.ndarray, "R N"]:
    """Count of each scene in each resample."""
    random = np.random.default_rng([seed, num_scenes])
    share = np.full(num_scenes, 1 / max(num_scenes, 1))
    return random.multinomial(num_scenes, share, NUM_RESAMPLES).astype(float)


def mean_over_scenes(
    sums: Float[np.ndarray, "*cells N"],
    counts: Float[np.ndarray, "*cells N"],
    weights: Float[np.ndarray, "R N"],
) -> Estimate:
    """Means of values, given their sums and counts in each of N scenes.

    All values have the same weight. Scenes are resampled, since agents of one scene are
    correlated. Resamples without a value are left out.
    """
    total = counts.sum(axis=-1)
    with np.errstate(invalid="ignore"):
        value = sums.sum(axis=-1) / total
        resampled = (sums @ weights.T) / (counts @ weights.T)
    resampled.sort(axis=-1)
    num_valid = np.isfinite(resampled).sum(axis=-1)
    known = (counts > 0).sum(axis=-1) > 1
    low, high = (
        np.where(known, _quantile(resampled, num_valid, at), np.nan)
        for at in ((1 - COVERAGE) / 2, (1 + COVERAGE) / 2)
    )
    return Estimate(value=value, low=low, high=high)


def _quantile(
    ordered: Float[np.ndarray, "*cells R"], count: np.ndarray, at: float
) -> Float[np.ndarray, "*cells"]:
    """Quantile of the first ``count`` numbers of each row, which are sorted."""
    place = at * np.maximum(count - 1, 0)
    below = np.floor(place).astype(int)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (
        np.take_along_axis(ordered, index[..., None], axis=-1)[..., 0]
        for index in (below, above)
    )
    return low + (place - below) * (high - low)
