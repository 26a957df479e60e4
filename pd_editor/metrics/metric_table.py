"""Table of all metrics: unit, source, preferred direction, definition."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

Source = Literal["paper", "ours"]
Better = Literal["lower", "higher", "as recorded"]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """Name, unit and meaning of a metric."""

    name: str
    unit: str
    """"share" is a number in 0..1; for a single agent it is true or false."""
    source: Source
    """"paper": as Path Diffuser's code computes it, faults included."""
    better: Better
    definition: str


def _metric(
    name: str, unit: str, source: Source, better: Better, definition: str
) -> Metric:
    return Metric(
        name=name, unit=unit, source=source, better=better, definition=definition
    )


_ALL: Final = (
    _metric(
        "init_collision_2m",
        "share",
        "paper",
        "lower",
        "At the current step, another centre of the same group within 2 m (pedestrians 1 m).",
    ),
    _metric(
        "actor_collision_2m",
        "share",
        "paper",
        "lower",
        "actorCR: steps, current one included, with such a centre; averaged over agent-steps.",
    ),
    _metric(
        "init_overlap",
        "share",
        "ours",
        "lower",
        "At the current step, the box shares more than 0.05 m^2 with another road user's.",
    ),
    _metric(
        "new_overlap",
        "share",
        "ours",
        "lower",
        "At a later step, the box overlaps one that it did not overlap at the current step.",
    ),
    _metric(
        "new_overlap_steps",
        "share",
        "ours",
        "lower",
        "Share of later steps with such a new overlap.",
    ),
    _metric(
        "init_off_road_4m",
        "share",
        "paper",
        "lower",
        "At the current step, no centre-line point of lanes or crosswalks within 4 m.",
    ),
    _metric(
        "off_road_4m_whole_path",
        "share",
        "paper",
        "lower",
        "None of the steps has a centre-line point within 4 m: one point saves a path.",
    ),
    _metric(
        "off_road_4m",
        "share",
        "ours",
        "lower",
        "At any step, no centre-line point within 4 m.",
    ),
    _metric(
        "off_road_4m_steps",
        "share",
        "ours",
        "lower",
        "Share of steps without a centre-line point within 4 m.",
    ),
    _metric(
        "init_off_drivable",
        "share",
        "ours",
        "lower",
        "At the current step, the centre is outside the drivable area.",
    ),
    _metric(
        "off_drivable",
        "share",
        "ours",
        "lower",
        "At any step, the centre is outside the drivable area (Scene-Attack's HOR).",
    ),
    _metric(
        "off_drivable_steps",
        "share",
        "ours",
        "lower",
        "Share of steps with the centre outside the drivable area (Scene-Attack's SOR).",
    ),
    _metric(
        "nearest_edge",
        "m",
        "paper",
        "as recorded",
        "At the current step, distance to the nearest centre-line point (also Lat. Dev. JSD).",
    ),
    _metric(
        "nearest_edge_angle",
        "deg",
        "paper",
        "as recorded",
        "At the current step, heading minus that point's direction, in -180..180.",
    ),
    _metric(
        "lateral_deviation_mean",
        "m",
        "ours",
        "lower",
        "Mean over later steps of the lateral distance to the lanes reachable from the "
        "initial ones. (The paper's 'average lateral deviation' has no usable definition.)",
    ),
    _metric(
        "lateral_deviation_final",
        "m",
        "ours",
        "lower",
        "The same at the last step.",
    ),
    _metric(
        "angular_deviation_mean",
        "deg",
        "ours",
        "lower",
        "Mean over later steps of the angle between heading and the nearest such lane.",
    ),
    _metric(
        "wrong_way",
        "share",
        "ours",
        "lower",
        "Share of later moving steps on lanes (2 m) of which none runs within 90 deg.",
    ),
    _metric(
        "nearest_distance",
        "m",
        "paper",
        "as recorded",
        "At the current step, distance to the nearest other centre of the same group; 0 alone.",
    ),
    _metric(
        "local_density",
        "m",
        "paper",
        "as recorded",
        "At the current step, the up to 5 smallest distances to others of the same group.",
    ),
    _metric(
        "askew_to_lane",
        "share",
        "ours",
        "as recorded",
        "Of vehicles standing at the current step: 15 to 75 deg off the direction of the nearest "
        "centre-line point, either way round.",
    ),
    _metric(
        "askew_to_neighbour",
        "share",
        "ours",
        "as recorded",
        "Of vehicles standing at the current step: over 15 deg off the nearest other vehicle, "
        "either way round.",
    ),
    _metric(
        "surroundings",
        "several",
        "ours",
        "as recorded",
        "At the current step, of vehicles, the features of the scene test: lane, kerb, "
        "neighbours and junction around each.",
    ),
    _metric("speed", "m/s", "paper", "as recorded", "Speed at the current step."),
    _metric(
        "standing",
        "share",
        "ours",
        "as recorded",
        "At the current step, slower than 0.3 m/s.",
    ),
    _metric(
        "starts",
        "share",
        "ours",
        "as recorded",
        "Of agents standing at the current step: moves more than 1 m away within the window.",
    ),
    _metric(
        "path_length", "m", "ours", "as recorded", "Length of the path in the window."
    ),
    _metric(
        "longitudinal_acceleration",
        "m/s^2",
        "ours",
        "as recorded",
        "Acceleration along the heading per step, from positions fitted over 2 s.",
    ),
    _metric(
        "lateral_acceleration",
        "m/s^2",
        "ours",
        "as recorded",
        "Acceleration to the left per step, from the same fit.",
    ),
    _metric(
        "jerk",
        "m/s^3",
        "ours",
        "as recorded",
        "Length of the third derivative per step, from the same fit.",
    ),
    _metric(
        "yaw_rate",
        "rad/s",
        "ours",
        "as recorded",
        "Turning rate per step, from headings fitted over 2 s.",
    ),
    _metric(
        "uncomfortable",
        "share",
        "ours",
        "lower",
        "At any step beyond a nuPlan comfort limit: acceleration ahead -4.05..2.40 "
        "m/s^2, to the side 4.89 m/s^2, jerk 8.37 m/s^3, yaw rate 0.95 rad/s.",
    ),
    _metric("uncomfortable_steps", "share", "ours", "lower", "Share of such steps."),
    _metric(
        "impossible",
        "share",
        "ours",
        "lower",
        "At any step beyond physics: acceleration over 9.81 m/s^2, or curvature over "
        "0.3 1/m above 2 m/s.",
    ),
    _metric("impossible_steps", "share", "ours", "lower", "Share of such steps."),
    _metric(
        "time_to_collision",
        "s",
        "ours",
        "as recorded",
        "Least time until boxes would touch if both kept their velocity; none over 5 s.",
    ),
    _metric(
        "critical_time_to_collision",
        "share",
        "ours",
        "lower",
        "At any step, a time to collision under 0.95 s (nuPlan's bound).",
    ),
    _metric(
        "post_encroachment_time",
        "s",
        "ours",
        "as recorded",
        "Least time between one box leaving a place and another entering it, following "
        "included; 0 if both are there at once.",
    ),
    _metric(
        "minimum_gap",
        "m",
        "ours",
        "as recorded",
        "Least distance between this box and another road user's in the window.",
    ),
    _metric(
        "ade_with_state",
        "m",
        "paper",
        "lower",
        "Mean distance to the recording over all steps, the current one (error 0) included.",
    ),
    _metric(
        "ade", "m", "ours", "lower", "Mean distance to the recording over later steps."
    ),
    _metric(
        "fde",
        "m",
        "paper",
        "lower",
        "Distance to the recording at its last step.",
    ),
    _metric(
        "missed", "share", "paper", "lower", "Whether that distance exceeds 2 m (MR)."
    ),
    _metric("min_ade", "m", "ours", "lower", "The least ADE among an agent's samples."),
    _metric("min_fde", "m", "ours", "lower", "The least FDE among an agent's samples."),
    _metric(
        "min_missed", "share", "ours", "lower", "Whether all samples miss by over 2 m."
    ),
    _metric(
        "pairwise_ade",
        "m",
        "ours",
        "higher",
        "Mean over pairs of an agent's samples of their ADE.",
    ),
    _metric(
        "end_spread",
        "m",
        "ours",
        "higher",
        "Mean over pairs of an agent's samples of the distance between their ends.",
    ),
    _metric(
        "lane_coverage",
        "share",
        "ours",
        "higher",
        "Share of the lanes reachable within the longest sample that a sample visits.",
    ),
)

METRICS: Final[Mapping[str, Metric]] = {metric.name: metric for metric in _ALL}
"""All metrics of agents by name; distances of distributions are computed from them."""
