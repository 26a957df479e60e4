"""Maximum mean discrepancy (MMD) between distributions."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

_MAX_POINTS: Final = 3000


@dataclass(frozen=True, kw_only=True)
class MeanDiscrepancy:
    """Maximum mean discrepancy between two sets."""

    squared: float
    """Unbiased estimate of the squared MMD; may be slightly below 0."""
    bandwidth: float
    is_valid: bool
    """False if a set has fewer than two points, or the reference has no spread."""


def maximum_mean_discrepancy(
    first: Float[np.ndarray, "N D"], reference: Float[np.ndarray, "M D"]
) -> MeanDiscrepancy:
    """MMD with the kernel exp(-|x - y|^2 / (2 h^2)), h the reference's median distance.

    Gretton et al. (2012), unbiased form. Of more than 3,000 points, an evenly spaced
    subset is used.
    """
    first, reference = _thinned(first), _thinned(reference)
    if len(first) < 2 or len(reference) < 2:
        return MeanDiscrepancy(squared=0.0, bandwidth=0.0, is_valid=False)
    within = _squared_distances(reference, reference)
    above = within[np.triu_indices(len(reference), 1)]
    bandwidth = float(np.median(np.sqrt(above)))
    if bandwidth == 0:
        return MeanDiscrepancy(squared=0.0, bandwidth=0.0, is_valid=False)

    def kernel(squared: np.ndarray) -> np.ndarray:
        return np.exp(-squared / (2 * bandwidth**2))

    def mean_off_diagonal(matrix: np.ndarray) -> float:
        count = len(matrix)
        return float((matrix.sum() - np.trace(matrix)) / (count * (count - 1)))

    between = kernel(_squared_distances(first, reference)).mean()
    inside = mean_off_diagonal(kernel(_squared_distances(first, first)))
    squared = inside + mean_off_diagonal(kernel(within)) - 2 * between
    return MeanDiscrepancy(squared=float(squared), bandwidth=bandwidth, is_valid=True)


def _thinned(points: Float[np.ndarray, "N D"]) -> Float[np.ndarray, "M D"]:
    if len(points) <= _MAX_POINTS:
        return points
    return points[np.linspace(0, len(points) - 1, _MAX_POINTS).astype(int)]


def _squared_distances(
    first: Float[np.ndarray, "N D"], second: Float[np.ndarray, "M D"]
) -> Float[np.ndarray, "N M"]:
    products = first @ second.T
    squares = (first**2).sum(1)[:, None] + (second**2).sum(1)
    return np.maximum(squares - 2 * products, 0.0)
