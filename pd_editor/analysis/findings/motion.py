"""Findings on how agents move: harsh or impossible motion, against traffic, no past."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.findings.finding import Finding, FindingKind, finding_of_agent
from pd_editor.analysis.metrics.lanes import lane_deviation
from pd_editor.analysis.metrics.motion import (
    COMFORT,
    MAX_ACCELERATION_MPS2,
    MAX_CURVATURE_PER_M,
    TURNING_MPS,
    Kinematics,
    kinematics,
)
from pd_editor.analysis.metrics.traffic_view import (
    TrafficView,
    traffic_with_made_up_past,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.scenario import Scenario

LEAST_AGAINST_S: Final = 1.0
"""Shorter times against a lane count as a way across it, or as noise of headings."""


def motion_findings(view: TrafficView) -> list[Finding]:
    """Find agents whose motion is harsh, or no vehicle's; at the worst of their steps."""
    now = np.full(len(view), view.scenario.current_step)
    kinds: tuple[FindingKind, FindingKind] = ("harsh-motion", "impossible-motion")
    return _too_hard(view, kinematics(view), now, kinds)


def made_up_motion(scenario: Scenario) -> list[Finding]:
    """Find agents whose made-up past is harsh, or no vehicle's."""
    view, first = traffic_with_made_up_past(scenario)
    # Made-up motion has no noise, and longer fits would hide a sharp turn.
    motion = kinematics(view, 11)
    steps = first[:, None] + np.arange(view.num_steps)
    motion = replace(
        motion,
        is_valid=motion.is_valid & (steps < scenario.current_step),
        # The limit of jerk is one of longer fits.
        jerk_mps3=np.zeros_like(motion.jerk_mps3),
    )
    return _too_hard(view, motion, first, ("harsh-past", "impossible-past"))


def _too_hard(
    view: TrafficView,
    motion: Kinematics,
    first: Int[np.ndarray, "A"],
    kinds: tuple[FindingKind, FindingKind],
) -> list[Finding]:
    """Agents beyond comfort and beyond physics; their rows start at steps ``first``."""
    forward, lateral = motion.longitudinal_mps2, motion.lateral_mps2
    yaw, total = np.abs(motion.yaw_rate_radps), np.hypot(forward, lateral)
    turns = motion.speed_mps > TURNING_MPS
    bend = np.where(turns, yaw / np.where(turns, motion.speed_mps, 1.0), 0.0)
    comfort = (
        (forward, COMFORT.braking_mps2, "brakes with {:.1f} m/s\u00b2"),
        (forward, COMFORT.acceleration_mps2, "accelerates with {:.1f} m/s\u00b2"),
        (np.abs(lateral), COMFORT.lateral_mps2, "{:.1f} m/s\u00b2 sideways"),
        (motion.jerk_mps3, COMFORT.jerk_mps3, "jerk of {:.0f} m/s\u00b3"),
        (
            np.degrees(yaw),
            np.degrees(COMFORT.yaw_rate_radps),
            "turns with {:.0f} \u00b0/s",
        ),
    )
    physics = (
        (total, MAX_ACCELERATION_MPS2, "{:.0f} m/s\u00b2 in all"),
        (bend, MAX_CURVATURE_PER_M, "curvature of {:.2f} per metre"),
    )
    return [
        *_beyond_limits(view, motion, first, kinds[0], comfort),
        *_beyond_limits(view, motion, first, kinds[1], physics),
    ]


def _beyond_limits(
    view: TrafficView,
    motion: Kinematics,
    first: Int[np.ndarray, "A"],
    kind: FindingKind,
    measures: tuple[tuple[Float[np.ndarray, "A H"], float, str], ...],
) -> list[Finding]:
    """Agents that exceed one of several limits, told by the measure that is worst."""
    ratios = np.stack([value / limit for value, limit, _ in measures])
    over = motion.is_valid & (ratios.max(axis=0) > 1.0)
    found = []
    for row, scene_row in _rows(view, over):
        at = np.flatnonzero(over[row])
        worst = at[ratios[:, row, at].max(axis=0).argmax()]
        value, limit, text = measures[int(ratios[:, row, worst].argmax())]
        words = text.format(abs(value[row, worst]))
        found.append(
            finding_of_agent(
                view.scenario,
                kind,
                scene_row,
                at + first[row],
                value=abs(float(value[row, worst])),
                limit=abs(limit),
                worst=int(worst + first[row]),
                words=(f" {words}", f"moves harder than {_THAN[kind]}: {words}."),
            )
        )
    return found


_THAN: Final = {
    "harsh-motion": "is comfortable",
    "impossible-motion": "a vehicle can",
    "harsh-past": "is comfortable, before t = 0",
    "impossible-past": "a vehicle can, before t = 0",
}


def against_traffic(view: TrafficView) -> list[Finding]:
    """Find agents that move against all lanes that they are on."""
    wrong = lane_deviation(view).is_wrong_way
    least = round(LEAST_AGAINST_S / view.step_s)
    wrong = wrong & (wrong.sum(axis=1, keepdims=True) >= least)
    now, found = view.scenario.current_step, []
    for row, scene_row in _rows(view, wrong):
        seconds = float(wrong[row].sum() * view.step_s)
        found.append(
            finding_of_agent(
                view.scenario,
                "against-traffic",
                scene_row,
                np.flatnonzero(wrong[row]) + now,
                value=seconds,
                limit=LEAST_AGAINST_S,
                words=(
                    f" against traffic for {seconds:.1f} s",
                    f"drives against its lane for {seconds:.1f} s.",
                ),
            )
        )
    return found


def without_past(scenario: Scenario) -> list[Finding]:
    """Find road users of the current step that were never observed before."""
    agents, now = scenario.agents, scenario.current_step
    new = agents.is_valid[:, now] & ~agents.is_valid[:, :now].any(axis=1)
    new &= agents.kind_mask(ROAD_USER_KINDS) & (now > 0)
    return [
        finding_of_agent(
            scenario,
            "no-past",
            row,
            np.array([now]),
            value=0.0,
            words=(
                " without a past",
                "has no observed past, so loaders of the data leave it out.",
            ),
        )
        for row in np.flatnonzero(new).tolist()
    ]


def _rows(view: TrafficView, holds: Bool[np.ndarray, "A H"]) -> list[tuple[int, int]]:
    """Rows of the view for which something holds at any step, with those of the scene."""
    row_of = view.scenario.agents.row_of
    rows = np.flatnonzero(holds.any(axis=1)).tolist()
    return [(row, row_of[view.agents.ids[row]]) for row in rows]
