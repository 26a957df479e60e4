"""Computes all metrics of a scene.

Values that depend on the map only (lane graph, distances between lanes, map points,
drivable area) are cached as long as the map value lives.
"""

from collections.abc import Sequence

from pd_editor.analysis.metrics.box_overlaps import (
    actor_collision_2m,
    box_overlap,
    init_collision_2m,
    init_five_circles,
    local_density,
    nearest_distance,
)
from pd_editor.analysis.metrics.lanes import lane_deviation, nearest_edge, off_lane
from pd_editor.analysis.metrics.likelihoods import likelihood_values
from pd_editor.analysis.metrics.motion import (
    ade,
    ade_with_state,
    best_of_samples,
    diversity_values,
    fde,
    kinematics,
    missed,
    motion_values,
)
from pd_editor.analysis.metrics.road import askew, surroundings
from pd_editor.analysis.metrics.safety import safety_values
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues


def agent_values(view: TrafficView) -> dict[str, MetricValues]:
    """All metrics of one sample by name.

    Each has a row per evaluated agent: [A], but [A 5] for ``local_density``,
    [A F] for ``surroundings``, and [A H]
    for the accelerations, ``jerk`` and ``yaw_rate``.
    """
    overlap, motion = box_overlap(view), kinematics(view)
    singles = (
        init_collision_2m(view),
        actor_collision_2m(view),
        overlap.at_state(),
        init_five_circles(view),
        overlap.newly(),
        overlap.new_steps(),
        *nearest_edge(view),
        nearest_distance(view),
        local_density(view),
        *askew(view),
        surroundings(view),
        ade_with_state(view),
        ade(view),
        fde(view),
        missed(view),
    )
    return {
        **{values.name: values for values in singles},
        **off_lane(view).values(),
        **lane_deviation(view).values(),
        **motion_values(view),
        **motion.per_step(),
        **motion.values(),
        **safety_values(view),
    }


def sample_values(views: Sequence[TrafficView]) -> dict[str, MetricValues]:
    """Metrics of several samples of the same agents by name, with a row per agent."""
    return {
        **best_of_samples(views),
        **diversity_values(views),
        **likelihood_values(views),
    }
