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


def guidance_report(
    scenario: Scenario,
    sample: TrafficSample,
    terms: Sequence[GuidanceTerm],
    unguided: Sequence[TrafficSample] = (),
    index: int = 0,
    slowed_ids: Sequence[str] = (),
) -> GuidanceReport:
    """Report on a guided sample.

    Args:
        scenario: scenario with the current states of all agents.
        sample: the guided sample.
        terms: terms in force.
        unguided: unguided samples, if they were made.
        index: index among them of the one of the same seed.
        slowed_ids: agents of the sample that were slowed to avoid a collision.
    """
    problems = guidance_problems(scenario, terms, sample.ids)
    outcomes = term_outcomes(
        scenario, sample, terms, infeasible_terms(problems), slowed_ids
    )
    cost, best = None, None
    if unguided:
        # A contact that was asked for does not count.
        asked = {
            name
            for term in terms
            if isinstance(term, Threaten) and term.is_on and term.severity == 1
            for name in term.named_ids
        }
        figures = [realism(scenario, one, asked) for one in unguided]
        cost = GuidanceCost(
            guided=realism(scenario, sample, asked), unguided=figures[index]
        )
        if cost.is_worse:
            ranked = sorted(
                range(len(unguided)),
                key=lambda one: (
                    figures[one].num_collisions,
                    figures[one].off_road,
                    figures[one].lateral_deviation_m,
                ),
            )
            best = unguided[ranked[0]]
    return GuidanceReport(
        outcomes=outcomes,
        cost=cost,
        unguided=best,
        motion_problems=motion_problems(scenario, sample),
    )


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
