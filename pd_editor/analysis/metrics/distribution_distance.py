"""Distances between the generated and recorded distribution of metrics."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.metrics.values import MaskedValues, Source

NUM_RESAMPLES: Final = 200


@dataclass(frozen=True, kw_only=True)
class DistributionDistance:
    """Distance between two sets of values."""

    divergence: float
    """Jensen-Shannon divergence, natural logarithm, 0..ln 2."""
    is_valid: bool
    """False if a set has no value in the histogram."""

    @property
    def root(self) -> float:
        """Jensen-Shannon distance: square root of the divergence; the paper's JSD."""
        return float(np.sqrt(self.divergence))


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """Bins of equal width for the values of a metric."""

    metric: str
    """Its name."""
    source: Source
    low: float
    high: float
    num_bins: int

    @property
    def drops_out_of_range(self) -> bool:
        """Whether values out of range are dropped, as in the paper; ours have two bins."""
        return self.source == "paper"

    def counts(self, values: Float[np.ndarray, "N"]) -> Float[np.ndarray, "B"]:
        """Number of values in each bin; the last bin includes its end."""
        edges = np.linspace(self.low, self.high, self.num_bins + 1)
        inside = np.histogram(values, edges)[0].astype(float)
        if self.drops_out_of_range:
            return inside
        below, above = np.sum(values < self.low), np.sum(values > self.high)
        return np.concatenate([[below], inside, [above]]).astype(float)

    def distance(
        self, first: Float[np.ndarray, "N"], second: Float[np.ndarray, "M"]
    ) -> DistributionDistance:
        """Distance between two sets of values."""
        one, two = self.counts(first), self.counts(second)
        if not one.any() or not two.any():
            return DistributionDistance(divergence=0.0, is_valid=False)
        return DistributionDistance(
            divergence=jensen_shannon_divergence(one, two), is_valid=True
        )


def _paper(metric: str, low: float, high: float, num_bins: int) -> Histogram:
    return replace(_ours(metric, low, high, num_bins), source="paper")


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
    _ours("length", 0, 20, 40),
    _ours("width", 0, 4, 40),
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
"""Histograms of all distances."""


def histogram_of(metric: str, source: Source) -> Histogram:
    """Histogram of a metric, the paper's or ours."""
    (found,) = (h for h in HISTOGRAMS if h.metric == metric and h.source == source)
    return found


def jensen_shannon_divergence(
    first: Float[np.ndarray, "B"], second: Float[np.ndarray, "B"]
) -> float:
    """Jensen-Shannon divergence of two non-empty histograms; natural logarithm."""
    return float(jensen_shannon_divergences(first[None], second[None])[0])


def jensen_shannon_divergences(
    first: Float[np.ndarray, "N B"], second: Float[np.ndarray, "N B"]
) -> Float[np.ndarray, "N"]:
    """Divergences of pairs of histograms; NaN where one is empty."""
    with np.errstate(invalid="ignore"):
        p, q = (one / one.sum(axis=1, keepdims=True) for one in (first, second))
    middle = (p + q) / 2
    safe = np.where(middle > 0, middle, 1.0)
    total = np.zeros(len(first))
    for share in (p, q):
        ratio = np.where(share > 0, share / safe, 1.0)
        total += (share * np.log(ratio)).sum(axis=1) / 2
    return np.maximum(total, 0.0)


def discrepancy_kernel(
    recorded: Float[np.ndarray, "N F"], generated: Float[np.ndarray, "M F"]
) -> Float[np.ndarray, "K K"]:
    """Gaussian kernel of the maximum mean discrepancy between all values, recorded first.

    Features are divided by their recorded deviation; the kernel is as wide as the median
    recorded distance. Source: Gretton et al., A kernel two-sample test, 2012.
    """
    scale = recorded.std(axis=0)
    values = np.concatenate([recorded, generated]) / np.where(scale > 0, scale, 1.0)
    values -= values[: len(recorded)].mean(axis=0)
    length = (values**2).sum(axis=1)
    squared = np.maximum(length[:, None] + length - 2 * values @ values.T, 0.0)
    median = np.median(squared[: len(recorded), : len(recorded)])
    return np.exp(-squared / (2 * median if median > 0 else 1.0))


def mean_discrepancy(
    kernel: Float[np.ndarray, "K K"], difference: Float[np.ndarray, "R K"]
) -> Float[np.ndarray, "R"]:
    """Maximum mean discrepancies; weights of one set are positive, the other's negative."""
    squared = ((difference @ kernel) * difference).sum(axis=-1)
    return np.sqrt(np.maximum(squared, 0.0))


def noise_floor(
    real_scenes: Sequence[MaskedValues],
    distance: Callable[[np.ndarray, np.ndarray], float],
    *,
    num_agents: int,
    num_resamples: int = NUM_RESAMPLES,
) -> float:
    """Mean distance between all real scenes and resampled real scenes.

    Whole scenes are resampled with replacement, the last one cut to the number of
    agents. ``distance`` takes the valid values of the resample and of all scenes.

    Args:
        real_scenes: values per scene; agents without a valid value do not count.
        distance: for example ``lambda a, b: histogram.distance(a, b).root``.
        num_agents: number of agents of the set under test.
        num_resamples: number of resamples.
    """
    scenes = [scene.taken(scene.has_value()) for scene in real_scenes]
    scenes = [scene for scene in scenes if len(scene)]
    assert scenes, "a noise floor needs real values"
    assert num_agents > 0
    everything = np.concatenate([scene.valid() for scene in scenes])
    random = np.random.default_rng(0)
    found = np.zeros(num_resamples)
    for index in range(num_resamples):
        parts: list[np.ndarray] = []
        missing = num_agents
        while missing > 0:
            scene = scenes[random.integers(len(scenes))]
            if len(scene) > missing:
                scene = scene.taken(random.permutation(len(scene))[:missing])
            parts.append(scene.valid())
            missing -= len(scene)
        found[index] = distance(np.concatenate(parts), everything)
    return float(found.mean())
