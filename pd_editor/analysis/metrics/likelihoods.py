"""Likelihoods of the recording among samples, as in Waymo's sim agents challenge.

For each agent and feature, the values of all samples at all steps are a histogram; the
log-likelihood of the recorded values in it is averaged over the recorded steps (Montali
et al., NeurIPS 2023; ranges, bins and weights of the challenge of 2025). Traffic lights
are left out, for recordings do not tell their states.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.road import drivable_ground, road_edge
from pd_editor.analysis.metrics.safety import nearest_box_m, times_s
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import (
    MaskedValues,
    MetricValues,
    mean_over_steps,
)

NUM_SAMPLES: Final = 32
"""Number of samples of the challenge; a single one weighs as much as these."""
_EVERY: Final = 5
"""Steps between those at which distances to the road's edge are measured."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """A feature, its weight in the meta-metric, and the bins of its histogram."""

    weight: float
    low: float = 0.0
    high: float = 1.0
    num_bins: int = 2
    """Two bins: whether something happens at any step."""


LIKELIHOODS: Final = {
    "likelihood_of_speed": Feature(weight=0.05, high=25.0, num_bins=10),
    "likelihood_of_acceleration": Feature(
        weight=0.05, low=-12.0, high=12.0, num_bins=11
    ),
    "likelihood_of_yaw_rate": Feature(weight=0.05, low=-0.628, high=0.628, num_bins=11),
    "likelihood_of_yaw_acceleration": Feature(
        weight=0.05, low=-3.14, high=3.14, num_bins=11
    ),
    "likelihood_of_nearest": Feature(weight=0.1, low=-5.0, high=40.0, num_bins=10),
    "likelihood_of_time_to_collision": Feature(weight=0.1, high=5.0, num_bins=10),
    "likelihood_of_road_edge": Feature(weight=0.05, low=-20.0, high=40.0, num_bins=10),
    "likelihood_of_collision": Feature(weight=0.25),
    "likelihood_of_off_road": Feature(weight=0.25),
}
"""Metrics of this module: logarithms, each a mean over an agent's steps."""


def meta_metric(
    log_likelihood: dict[str, Float[np.ndarray, "*cells"]],
) -> Float[np.ndarray, "*cells"]:
    """Weighted mean of the likelihoods, 0 to 1, given their logarithms by name."""
    total = sum(one.weight for one in LIKELIHOODS.values())
    parts = [
        one.weight * np.exp(log_likelihood[name]) for name, one in LIKELIHOODS.items()
    ]
    return np.sum(parts, axis=0) / total


def likelihood_values(views: Sequence[TrafficView]) -> dict[str, MetricValues]:
    """Log-likelihoods of the recorded motion by name, each [A]."""
    first = views[0]
    recorded = _features(replace(first, agents=first.logged))
    sampled = [_features(view) for view in views]
    return {
        name: _log_likelihood(
            name, recorded[name], [one[name] for one in sampled], feature
        )
        for name, feature in LIKELIHOODS.items()
    }


def _log_likelihood(
    name: str,
    recorded: MaskedValues,
    sampled: Sequence[MaskedValues],
    feature: Feature,
) -> MetricValues:
    """Mean log-likelihood of an agent's recorded values in the histogram of samples."""
    happens = feature.num_bins == 2
    smoothing = 0.001 if happens else 0.1
    counts = np.full((len(recorded), feature.num_bins), smoothing)
    weight = NUM_SAMPLES if len(sampled) == 1 else 1
    for one in sampled:
        agent, step = np.nonzero(one.is_valid)
        bins = _bins(one.value[agent, step], feature)
        np.add.at(counts, (agent, bins), weight)
    share = np.log(counts / counts.sum(axis=1, keepdims=True))
    found = np.take_along_axis(share, _bins(recorded.value, feature), axis=1)
    return mean_over_steps(name, found, recorded.is_valid)


def _bins(value: np.ndarray, feature: Feature) -> np.ndarray:
    """Bin of each value; what is out of range is in the first or the last one."""
    place = (value - feature.low) / (feature.high - feature.low) * feature.num_bins
    return np.clip(place.astype(int), 0, feature.num_bins - 1)


def _features(view: TrafficView) -> dict[str, MaskedValues]:
    """All features by the names of their likelihoods, [A S] or, of events, [A 1]."""
    agents, step_s = view.agents, view.step_s
    exists = agents.is_valid
    velocity, moves = _rate(agents.position_m, exists, step_s)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    yaw_rate, _ = _rate(np.unwrap(agents.heading_rad, axis=1), exists, step_s)
    nearest = nearest_box_m(view)
    has_other = exists & np.isfinite(nearest)
    edge_m, is_seen = _beyond_edge_m(view), exists[:, ::_EVERY]
    hits = box_overlap(view).is_overlapping & exists
    values = (
        (speed, moves),
        _rate(speed, moves, step_s),
        (yaw_rate, moves),
        _rate(yaw_rate, moves, step_s),
        (np.where(has_other, nearest, 0.0), has_other),
        (times_s(view), exists),
        (edge_m, is_seen),
        _event(hits, exists),
        _event(edge_m > 0, is_seen),
    )
    return {
        name: MaskedValues(value=np.asarray(value, float), is_valid=is_valid)
        for name, (value, is_valid) in zip(LIKELIHOODS, values, strict=True)
    }


def _rate(
    value: Float[np.ndarray, "A S *rest"],
    is_valid: Bool[np.ndarray, "A S"],
    step_s: float,
) -> tuple[Float[np.ndarray, "A T *rest"], Bool[np.ndarray, "A T"]]:
    """Central differences, at all steps but the first and the last one."""
    rate = (value[:, 2:] - value[:, :-2]) / (2 * step_s)
    return rate, is_valid[:, 2:] & is_valid[:, :-2]


def _event(
    happens: Bool[np.ndarray, "A S"], is_valid: Bool[np.ndarray, "A S"]
) -> tuple[Bool[np.ndarray, "A 1"], Bool[np.ndarray, "A 1"]]:
    """Whether something happens at any step."""
    ever = np.any(happens & is_valid, axis=1, keepdims=True)
    return np.asarray(ever), np.asarray(np.any(is_valid, axis=1, keepdims=True))


def _beyond_edge_m(view: TrafficView) -> Float[np.ndarray, "A S"]:
    """Distance from the road's edge of the corner furthest out, negative on the road."""
    ground = drivable_ground(view.scenario.road_map)
    states = view.agents.at_steps(slice(None, None, _EVERY))
    corners = states.boxes.corners_m()
    away = shapely.distance(road_edge(view.scenario.road_map), shapely.points(corners))
    is_on = shapely.contains_xy(ground, corners[..., 0], corners[..., 1])
    signed = np.where(is_on, -away, away)
    return np.nan_to_num(signed).max(axis=-1)
