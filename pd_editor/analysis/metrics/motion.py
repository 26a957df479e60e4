"""Displacement errors, diversity of samples; speed, acceleration, jerk, yaw rate and their limits.

Recorded positions carry noise of some centimetres, whose second difference at 10 Hz
is many m/s^2. So cubics are fitted over two seconds (Savitzky and Golay, 1964), and
all derivatives, of generated paths as well, are those of the fits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.lanes import (
    evaluated_steps,
    path_length_m,
    reachable_lanes,
)
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import (
    MetricValues,
    any_step,
    by_name,
    mean_over_steps,
    measured,
)
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.thresholds import MOVED_M, STANDING_MPS

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
    least_final, is_valid = _least(final), final[0].is_valid
    return by_name(
        measured("min_ade", _least(mean), mean[0].is_valid),
        measured("min_fde", least_final, is_valid),
        measured("min_missed", least_final > MISS_M, is_valid),
    )


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
    return by_name(
        measured("pairwise_ade", mean, has_spread),
        measured("end_spread", end, has_spread),
        _lane_coverage(views),
    )


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
        # An agent visits a lane if it comes this close to its centre line.
        agent, step = np.nonzero(steps & (distance <= 2.0))
        visited[agent, search.lane[segment[agent, step]]] = True
    number = np.maximum(reachable.sum(axis=1), 1)
    return measured("lane_coverage", visited.sum(axis=1) / number, is_valid)


WINDOW_STEPS: Final = 21
DEGREE: Final = 3
MAX_ACCELERATION_MPS2: Final = 9.81
"""Highest acceleration of tyres on a dry road."""
MAX_CURVATURE_PER_M: Final = 0.3
TURNING_MPS: Final = 2.0
"""Below this speed, yaw rate over speed is noise rather than curvature."""


@dataclass(frozen=True, kw_only=True)
class ComfortBounds:
    """nuPlan's limits of comfort."""

    braking_mps2: float = -4.05
    acceleration_mps2: float = 2.40
    lateral_mps2: float = 4.89
    jerk_mps3: float = 8.37
    yaw_rate_radps: float = 0.95


COMFORT: Final = ComfortBounds()


@dataclass(frozen=True, kw_only=True, eq=False)
class Kinematics:
    """Derivatives of A evaluated agents' paths at H steps, the current one first.

    A step is valid if the agent exists throughout its fit.
    """

    is_valid: Bool[np.ndarray, "A H"]
    speed_mps: Float[np.ndarray, "A H"]
    longitudinal_mps2: Float[np.ndarray, "A H"]
    lateral_mps2: Float[np.ndarray, "A H"]
    jerk_mps3: Float[np.ndarray, "A H"]
    yaw_rate_radps: Float[np.ndarray, "A H"]

    def is_uncomfortable(self) -> Bool[np.ndarray, "A H"]:
        """Whether a limit of comfort is exceeded."""
        return (
            (self.longitudinal_mps2 < COMFORT.braking_mps2)
            | (self.longitudinal_mps2 > COMFORT.acceleration_mps2)
            | (np.abs(self.lateral_mps2) > COMFORT.lateral_mps2)
            | (self.jerk_mps3 > COMFORT.jerk_mps3)
            | (np.abs(self.yaw_rate_radps) > COMFORT.yaw_rate_radps)
        )

    def is_impossible(self) -> Bool[np.ndarray, "A H"]:
        """Whether acceleration or curvature is physically impossible."""
        total = np.hypot(self.longitudinal_mps2, self.lateral_mps2)
        bend = np.abs(self.yaw_rate_radps) > MAX_CURVATURE_PER_M * self.speed_mps
        turns = bend & (self.speed_mps > TURNING_MPS)
        return (total > MAX_ACCELERATION_MPS2) | turns

    def per_step(self) -> dict[str, MetricValues]:
        """Derivatives by name, each [A H]."""
        valid = self.is_valid
        return by_name(
            measured("longitudinal_acceleration", self.longitudinal_mps2, valid),
            measured("lateral_acceleration", self.lateral_mps2, valid),
            measured("jerk", self.jerk_mps3, valid),
            measured("yaw_rate", self.yaw_rate_radps, valid),
        )

    def values(self) -> dict[str, MetricValues]:
        """Violations of limits by name, each [A]."""
        valid = self.is_valid
        harsh, impossible = self.is_uncomfortable(), self.is_impossible()
        return by_name(
            any_step("uncomfortable", harsh, valid),
            mean_over_steps("uncomfortable_steps", harsh, valid),
            any_step("impossible", impossible, valid),
            mean_over_steps("impossible_steps", impossible, valid),
        )


def kinematics(view: TrafficView, window: int = WINDOW_STEPS) -> Kinematics:
    """Derivatives of the evaluated agents' paths, from fits over ``window`` steps."""
    agents = view.agents
    first, second, third = derivative_operators(view.num_steps, window, view.step_s)
    acceleration = second @ agents.position_m
    forward = unit_vector(agents.heading_rad)
    # Headings of steps without a track are unwrapped too; their fits are not valid.
    heading = np.unwrap(agents.heading_rad, axis=1)
    return Kinematics(
        is_valid=whole_windows(agents.is_valid, window),
        speed_mps=np.linalg.norm(first @ agents.position_m, axis=-1),
        longitudinal_mps2=(acceleration * forward).sum(-1),
        lateral_mps2=(acceleration * left_of(forward)).sum(-1),
        jerk_mps3=np.linalg.norm(third @ agents.position_m, axis=-1),
        yaw_rate_radps=(first @ heading[..., None])[..., 0],
    )


def motion_values(view: TrafficView) -> dict[str, MetricValues]:
    """Metrics of size, and ``speed``, ``standing``, ``starts``, ``path_length``: [A]."""
    agents = view.agents
    here = agents.is_valid[:, 0]
    speed = np.hypot(agents.velocity_mps[:, 0, 0], agents.velocity_mps[:, 0, 1])
    stands = here & (speed < STANDING_MPS)
    offset = agents.position_m - agents.position_m[:, :1]
    away = np.hypot(offset[..., 0], offset[..., 1]) > MOVED_M
    has_future = here & np.any(agents.is_valid[:, 1:], axis=1)
    starts = np.any(away & agents.is_valid, axis=1)
    length = path_length_m(agents.position_m, agents.is_valid)
    return by_name(
        measured("length", agents.size_m[:, 0], here),
        measured("width", agents.size_m[:, 1], here),
        measured("speed", speed, here),
        measured("standing", stands, here),
        measured("starts", starts, stands & has_future),
        measured("path_length", length, has_future),
    )


@lru_cache(maxsize=8)
def derivative_operators(
    num_steps: int, window: int, step_s: float
) -> Float[np.ndarray, "3 H H"]:
    """Matrices that map H values to derivatives of cubics fitted around each step.

    Windows are centred, except at the first and the last steps, and no longer than the
    values. Fewer values than a cubic needs have no derivatives: all are 0.
    """
    operators = np.zeros((3, num_steps, num_steps))
    window = min(window, num_steps)
    if window <= DEGREE:
        return operators
    for row, start in enumerate(_window_starts(num_steps, window)):
        time = (np.arange(start, start + window) - row) * step_s
        fit = np.linalg.pinv(np.vander(time, DEGREE + 1, increasing=True))
        part = slice(start, start + window)
        for order, factorial in ((1, 1.0), (2, 2.0), (3, 6.0)):
            operators[order - 1, row, part] = factorial * fit[order]
    operators.flags.writeable = False
    return operators


def _window_starts(num_steps: int, window: int) -> np.ndarray:
    return np.clip(np.arange(num_steps) - window // 2, 0, num_steps - window)


def whole_windows(
    is_valid: Bool[np.ndarray, "A H"], window: int
) -> Bool[np.ndarray, "A H"]:
    """Whether each agent exists throughout the fitted window of each step.

    It has no derivatives otherwise, nor where ``derivative_operators`` have none.
    """
    window = min(window, is_valid.shape[1])
    if window <= DEGREE:
        return np.zeros_like(is_valid)
    before = np.pad(np.cumsum(is_valid, axis=1), ((0, 0), (1, 0)))
    start = _window_starts(is_valid.shape[1], window)
    return before[:, start + window] - before[:, start] == window
