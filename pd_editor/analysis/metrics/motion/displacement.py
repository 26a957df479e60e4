"""Displacement errors of generated trajectories against the recorded ones."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, mean_over_steps, measured

MISS_M: Final = 2.0


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
