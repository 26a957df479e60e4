"""Reports on guided samples: outcomes of terms, realism against unguided samples."""

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from pd_editor.generation import GuidanceReport, TrafficSample
from pd_editor.guidance.feasibility import guidance_problems, infeasible_terms
from pd_editor.guidance.outcomes import term_outcomes
from pd_editor.metrics.collisions.box_collision import box_overlap
from pd_editor.metrics.motion.kinematics import kinematics
from pd_editor.metrics.road.lane_deviation import lane_deviation
from pd_editor.metrics.road.off_road import is_off_road
from pd_editor.metrics.traffic_view import generated_traffic
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.guidance_outcome import GuidanceCost, Realism
from pd_editor.scene.guidance_terms import GuidanceTerm, Threaten
from pd_editor.scene.scenario import Scenario

_REVERSES_M: Final = 1.0
"""Way backwards from which on an agent counts as reversing."""
_MOST_NAMED: Final = 3


def guidance_reports(
    scenario: Scenario,
    samples: Sequence[TrafficSample],
    terms: Sequence[GuidanceTerm],
    unguided: Sequence[TrafficSample] = (),
    slowed_ids: Sequence[Sequence[str]] = (),
) -> tuple[GuidanceReport, ...]:
    """Reports on guided samples of the same agents.

    Args:
        scenario: scenario with the current states of all agents.
        samples: guided samples.
        terms: terms in force.
        unguided: the unguided sample of the same seed for each, if they were made.
        slowed_ids: agents of each sample that were slowed to avoid a collision.
    """
    if not samples:
        return ()
    problems = guidance_problems(scenario, terms, samples[0].ids)
    infeasible = infeasible_terms(problems)
    # A contact that was asked for does not count.
    asked = {
        name
        for term in terms
        if isinstance(term, Threaten) and term.is_on and term.severity == 1
        for name in term.named_ids
    }
    figures = [realism(scenario, one, asked) for one in unguided]
    best = min(range(len(figures)), key=lambda index: _order(figures[index]), default=0)
    found: list[GuidanceReport] = []
    for index, sample in enumerate(samples):
        cost = None
        if figures:
            guided = realism(scenario, sample, asked)
            cost = GuidanceCost(guided=guided, unguided=figures[index])
        slowed = slowed_ids[index] if slowed_ids else ()
        found.append(
            GuidanceReport(
                outcomes=term_outcomes(scenario, sample, terms, infeasible, slowed),
                cost=cost,
                unguided=unguided[best] if cost is not None and cost.is_worse else None,
                motion_problems=motion_problems(scenario, sample),
            )
        )
    return tuple(found)


def _order(figures: Realism) -> tuple[float, float, float]:
    """Order of unguided samples, the best one first."""
    return (figures.num_collisions, figures.off_road, figures.lateral_deviation_m)


def realism(
    scenario: Scenario, sample: TrafficSample, collide_ids: Collection[str] = ()
) -> Realism:
    """Realism of a sample, over its motor vehicles and cyclists.

    Collisions of agents with ``collide_ids``, which were asked for, do not count.
    """
    view = generated_traffic(scenario, sample)
    drives = np.array([kind in LANE_FOLLOWER_KINDS for kind in sample.kinds], bool)
    if not drives.any():
        return Realism(
            off_road=0.0,
            num_collisions=0,
            lateral_deviation_m=0.0,
            acceleration_mps2=0.0,
        )
    overlap = box_overlap(view)
    hits = (overlap.is_new & overlap.is_valid)[:, 1:].any(axis=1)
    hits &= np.array([name not in collide_ids for name in sample.ids], bool)
    deviation = lane_deviation(view)
    counted = deviation.is_valid & drives[:, None]
    motion = kinematics(view)
    total = np.hypot(motion.longitudinal_mps2, motion.lateral_mps2)
    known = motion.is_valid & drives[:, None]
    return Realism(
        off_road=float(is_off_road(scenario, sample.position_m[drives]).mean()),
        num_collisions=int(hits.sum()),
        lateral_deviation_m=_mean(deviation.lateral_m[counted]),
        acceleration_mps2=_mean(total[known]),
    )


def motion_problems(scenario: Scenario, sample: TrafficSample) -> tuple[str, ...]:
    """Sentences on agents that move as no vehicle can."""
    drives = np.array([kind in LANE_FOLLOWER_KINDS for kind in sample.kinds], bool)
    motion = kinematics(generated_traffic(scenario, sample))
    impossible = (motion.is_impossible() & motion.is_valid).any(axis=1) & drives
    forward = np.stack(
        [np.cos(sample.heading_rad), np.sin(sample.heading_rad)], axis=-1
    )
    step = (np.diff(sample.position_m, axis=1) * forward[:, 1:]).sum(-1)
    begins = (sample.velocity_mps[:, 0] * forward[:, 0]).sum(-1)
    backwards = np.minimum(step, 0.0).sum(axis=1) < -_REVERSES_M
    reverses = backwards & drives & (begins > 0)
    found: list[str] = []
    if impossible.any():
        found.append(
            f"{_names(sample, impossible)}: accelerations or curves that no vehicle can "
            "drive."
        )
    if reverses.any():
        found.append(f"{_names(sample, reverses)}: backwards out of forward motion.")
    return tuple(found)


def _names(sample: TrafficSample, mask: np.ndarray) -> str:
    rows = np.flatnonzero(mask)
    names = ", ".join(sample.ids[row] for row in rows[:_MOST_NAMED])
    more = len(rows) - _MOST_NAMED
    return f"Agent {names}" + (f" and {more} more" if more > 0 else "")


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else 0.0
