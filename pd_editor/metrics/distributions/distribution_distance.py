"""How far the distribution of a metric is from the recorded one.

The paper's histograms drop values out of their range, and its "JSD" is the square
root of the divergence; ours count what is out of range in two bins of its own. The
logarithm is the natural one, so a divergence is at most ln 2.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.metrics.metric_table import METRICS, Source


@dataclass(frozen=True, kw_only=True)
class DistributionDistance:
    """A distance of two sets of values."""

    divergence: float
    """Jensen-Shannon divergence, natural logarithm, 0..ln 2."""
    is_valid: bool
    """False where a set has no value in the histogram."""

    @property
    def root(self) -> float:
        """Square root of the divergence, which is what the paper calls JSD."""
        return float(np.sqrt(self.divergence))


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """Equal bins for the values of a metric."""

    metric: str
    """Key of ``METRICS``."""
    source: Source
    low: float
    high: float
    num_bins: int

    def __post_init__(self) -> None:
        assert self.metric in METRICS, self.metric

    @property
    def drops_out_of_range(self) -> bool:
        """The paper's do; ours have one more bin at each end."""
        return self.source == "paper"

    def counts(self, values: Float[np.ndarray, "N"]) -> Float[np.ndarray, "B"]:
        """How many values fall into each bin; the last one includes its end."""
        edges = np.linspace(self.low, self.high, self.num_bins + 1)
        inside = np.histogram(values, edges)[0].astype(float)
        if self.drops_out_of_range:
            return inside
        below, above = np.sum(values < self.low), np.sum(values > self.high)
        return np.concatenate([[below], inside, [above]]).astype(float)

    def distance(
        self, first: Float[np.ndarray, "N"], second: Float[np.ndarray, "M"]
    ) -> DistributionDistance:
        """Distance of two sets of values."""
        one, two = self.counts(first), self.counts(second)
        if not one.any() or not two.any():
            return DistributionDistance(divergence=0.0, is_valid=False)
        return DistributionDistance(
            divergence=jensen_shannon_divergence(one, two), is_valid=True
        )


def _paper(metric: str, low: float, high: float, num_bins: int) -> Histogram:
    return Histogram(
        metric=metric, source="paper", low=low, high=high, num_bins=num_bins
    )


def _ours(metric: str, low: float, high: float, num_bins: int) -> Histogram:
    return Histogram(
        metric=metric, source="ours", low=low, high=high, num_bins=num_bins
    )


HISTOGRAMS: Final = (
    _paper("nearest_distance", 0, 250, 250),
    _paper("local_density", 0, 150, 150),
    _paper("nearest_edge", 0, 3, 30),
    _paper("nearest_edge_angle", -180, 180, 72),
    _paper("speed", 0, 50, 50),
    _ours("nearest_distance", 0, 60, 30),
    _ours("local_density", 0, 100, 40),
    _ours("nearest_edge", 0, 10, 40),
    _ours("nearest_edge_angle", -180, 180, 72),
    _ours("speed", 0, 30, 30),
    _ours("path_length", 0, 120, 40),
    _ours("lateral_deviation_mean", 0, 10, 40),
    _ours("angular_deviation_mean", 0, 180, 36),
    _ours("longitudinal_acceleration", -8, 8, 32),
    _ours("lateral_acceleration", -6, 6, 24),
    _ours("jerk", 0, 15, 30),
    _ours("yaw_rate", -1, 1, 40),
    _ours("time_to_collision", 0, 5, 20),
    _ours("post_encroachment_time", 0, 5, 20),
    _ours("minimum_gap", 0, 30, 30),
)
"""All bins of all distances."""


def histogram_of(metric: str, source: Source) -> Histogram:
    """The bins of a metric, as the paper has them or ours."""
    (found,) = (h for h in HISTOGRAMS if h.metric == metric and h.source == source)
    return found


def jensen_shannon_divergence(
    first: Float[np.ndarray, "B"], second: Float[np.ndarray, "B"]
) -> float:
    """Divergence of two histograms, neither empty; natural logarithm."""
    p, q = first / first.sum(), second / second.sum()
    middle = (p + q) / 2
    safe = np.where(middle > 0, middle, 1.0)
    total = 0.0
    for share in (p, q):
        ratio = np.where(share > 0, share / safe, 1.0)
        total += float((share * np.log(ratio)).sum()) / 2
    return max(total, 0.0)
