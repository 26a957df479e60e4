"""Distances to other agents of the same group at the current step."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, measured

NUM_NEIGHBORS: Final = 5


def nearest_distance(view: TrafficView) -> MetricValues:
    """Distance to the nearest other centre [A]; 0 without one, as in the paper."""
    nearest = np.min(_distances_m(view), axis=1, initial=np.inf)
    return measured(
        "nearest_distance",
        np.where(np.isfinite(nearest), nearest, 0.0),
        view.agents.is_valid[:, 0],
    )


def local_density(view: TrafficView) -> MetricValues:
    """The smallest distances to others, sorted [A 5]; valid as far as there are others."""
    distance = np.sort(_distances_m(view), axis=1)[:, :NUM_NEIGHBORS]
    missing = NUM_NEIGHBORS - distance.shape[1]
    distance = np.pad(distance, ((0, 0), (0, missing)), constant_values=np.inf)
    is_valid = np.isfinite(distance) & view.agents.is_valid[:, :1]
    return measured("local_density", np.where(is_valid, distance, 0.0), is_valid)


def _distances_m(view: TrafficView) -> Float[np.ndarray, "A B"]:
    """Distances to agents of the same group; infinite to oneself and other groups."""
    agents, everyone = view.agents, view.everyone
    offset = agents.position_m[:, None, 0] - everyone.position_m[None, :, 0]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    counts = agents.group[:, None] == everyone.group
    counts &= everyone.is_valid[:, 0] & (everyone.group >= 0)
    np.fill_diagonal(counts, False)
    return np.where(counts, distance, np.inf)
