"""Displacement errors against the recording, and diversity of several samples."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.road.lane_deviation import path_length_m
from pd_editor.analysis.metrics.road.off_lane import evaluated_steps
from pd_editor.analysis.metrics.road.reachable_lanes import reachable_lanes
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, mean_over_steps, measured
from pd_editor.scene.paths.lanes.lane_graph import lane_graph

MISS_M: Final = 2.0

VISIT_M: Final = 2.0
"""An agent visits a lane if it comes this close to its centre line."""


def ade_with_state(view: TrafficView) -> MetricValues:
    """The paper's ADE [A], which includes the current step, where the error is 0."""
    return mean_over_steps("ade_with_state", _error_m(view), _is_known(view))


def ade(view: TrafficView) -> MetricValues:
    """Average displacement error: mean distance to the recording at later steps [A]."""
    return mean_over_steps("ade", _error_m(view)[:, 1:], _is_known(view)[:, 1:])


def fde(view: TrafficView) -> MetricValues:
    """Final displacement error: distance at the recording's last step [A]."""
    is_known = _is_known(view)
    last = is_known.shape[1] - 1 - is_known[:, ::-1].argmax(axis=1)
    error = _error_m(view)[np.arange(len(view)), last]
    return measured("fde", error, np.any(is_known[:, 1:], axis=1))


def missed(view: TrafficView) -> MetricValues:
    """Whether the final distance exceeds 2 m [A]."""
    final = fde(view)
    return measured("missed", final.value > MISS_M, final.is_valid)


def best_of_samples(views: Sequence[TrafficView]) -> dict[str, MetricValues]:
    """``min_ade``, ``min_fde`` and ``min_missed`` [A] over samples of the same agents."""
    assert all(view.agents.ids == views[0].agents.ids for view in views)
    mean, final = [ade(view) for view in views], [fde(view) for view in views]
    least = {"min_ade": _least(mean), "min_fde": _least(final)}
    is_valid = final[0].is_valid
    least_final = least["min_fde"]
    return {
        "min_ade": measured("min_ade", least["min_ade"], mean[0].is_valid),
        "min_fde": measured("min_fde", least_final, is_valid),
        "min_missed": measured("min_missed", least_final > MISS_M, is_valid),
    }


def _least(samples: Sequence[MetricValues]) -> Float[np.ndarray, "A"]:
    return np.min([one.value for one in samples], axis=0)


def _error_m(view: TrafficView) -> Float[np.ndarray, "A H"]:
    offset = view.agents.position_m - view.logged.position_m
    return np.hypot(offset[..., 0], offset[..., 1])


def _is_known(view: TrafficView) -> Bool[np.ndarray, "A H"]:
    return view.agents.is_valid & view.logged.is_valid


def diversity_values(views: Sequence[TrafficView]) -> dict[str, MetricValues]:
    """Metrics ``pairwise_ade``, ``end_spread`` and ``lane_coverage`` by name, each [A].

    The first two need at least two samples.
    """
    assert all(view.agents.ids == views[0].agents.ids for view in views)
    apart, is_valid = _distances_m(views)
    steps = is_valid[:, 1:]
    count = steps.sum(axis=1)
    mean = np.where(steps, apart[:, 1:], 0.0).sum(axis=1) / np.maximum(count, 1)
    has_spread = (count > 0) & (len(views) > 1)
    last = is_valid.shape[1] - 1 - is_valid[:, ::-1].argmax(axis=1)
    end = apart[np.arange(len(apart)), last]
    return {
        "pairwise_ade": measured("pairwise_ade", mean, has_spread),
        "end_spread": measured("end_spread", end, has_spread),
        "lane_coverage": _lane_coverage(views),
    }


def _distances_m(
    views: Sequence[TrafficView],
) -> tuple[Float[np.ndarray, "A H"], Bool[np.ndarray, "A H"]]:
    """Mean distance over pairs of samples, where all samples are valid."""
    position = np.stack([view.agents.position_m for view in views])
    is_valid = np.all([view.agents.is_valid for view in views], axis=0)
    total = np.zeros(is_valid.shape)
    for index in range(1, len(views)):
        offset = position[index:] - position[:-index]
        total += np.hypot(offset[..., 0], offset[..., 1]).sum(axis=0)
    return total / max(len(views) * (len(views) - 1) // 2, 1), is_valid


def _lane_coverage(views: Sequence[TrafficView]) -> MetricValues:
    agents, road_map = views[0].agents, views[0].scenario.road_map
    longest = np.max(
        [path_length_m(v.agents.position_m, v.agents.is_valid) for v in views], axis=0
    )
    reachable = reachable_lanes(
        road_map,
        agents.position_m[:, 0],
        agents.heading_rad[:, 0],
        agents.kinds,
        longest,
        spare_m=0.0,
    )
    is_valid = evaluated_steps(views[0])[:, 0] & np.any(reachable, axis=1)
    search = lane_graph(road_map).extended_search
    visited = np.zeros(reachable.shape, bool)
    for view in views:
        steps = evaluated_steps(view) & is_valid[:, None]
        distance, segment = search.nearest_on_paths(
            view.agents.position_m, steps, reachable
        )
        agent, step = np.nonzero(steps & (distance <= VISIT_M))
        visited[agent, search.lane[segment[agent, step]]] = True
    number = np.maximum(reachable.sum(axis=1), 1)
    return measured("lane_coverage", visited.sum(axis=1) / number, is_valid)
