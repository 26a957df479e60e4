"""Findings on pairs of agents whose boxes overlap, or pass each other closely.

Overlaps that are frequent in recordings and that no edit can resolve are left out:

- overlaps between static objects (cones, bins, signs), between pedestrians (they walk
  in groups), and between pedestrians and bicycles that they push;
- later overlaps of two stationary agents, which only come into view.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.findings.finding import (
    Finding,
    agent_name,
    at_time,
    capitalised,
    finding_of_agent,
    spans_of,
)
from pd_editor.analysis.metrics.box_overlaps import (
    MIN_OVERLAP_M2,
    overlaps_of_pairs,
    pairs_that_meet,
)
from pd_editor.analysis.metrics.safety import CRITICAL_S, box_gap_m, least_times_s
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.oriented_box import BoxStates, overlap_area
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, STATIONARY_M

NEAR_PASS_M: Final = 0.35
"""Boxes nearer than this pass each other closely."""
_PAIRS_AT_ONCE: Final = 1_000
MAX_COLLISIONS: Final = 500
"""Limit of reported collisions, which bounds time and memory."""


def collisions(scenario: Scenario, steps: Int[np.ndarray, "S"]) -> list[Finding]:
    """Find pairs that overlap at any of the increasing steps from the current one on.

    A pair that overlaps now is reported once, not again for later steps.
    """
    agents, now = scenario.agents, scenario.current_step
    boxes = agents.at_steps(steps)
    pairs, pair, at, area = _hits(agents, boxes)
    moves = _moves(boxes.position_m, boxes.is_valid)
    appears = np.where(
        agents.is_valid[:, now], now, agents.is_valid[:, now:].argmax(axis=1) + now
    )
    found = []
    bounds = np.flatnonzero(np.diff(pair, prepend=-1, append=-1))[: MAX_COLLISIONS + 1]
    for start, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        one, two = pairs[pair[start]].tolist()
        hit = steps[at[start:end]]
        first = int(hit[0])
        is_now = first == now
        if not is_now and not (moves[one] or moves[two]):
            continue
        names = [
            agent_name(agents, row)
            + (
                ""
                if appears[row] == now
                else f" (appears {at_time(scenario, int(appears[row]))})"
            )
            for row in (one, two)
        ]
        time = "" if is_now else f" {at_time(scenario, first)}"
        middle = (agents.position_m[one, first] + agents.position_m[two, first]) / 2
        worst = start + int(area[start:end].argmax())
        found.append(
            Finding(
                kind="collision" if is_now else "later-collision",
                agent_ids=(agents.ids[one], agents.ids[two]),
                spans=spans_of(hit),
                worst_step=int(steps[at[worst]]),
                value=float(area[worst]),
                limit=MIN_OVERLAP_M2,
                headline=f"{agents.ids[one]} and {agents.ids[two]} collide",
                message=f"{capitalised(names[0])} and {names[1]} collide{time}.",
                place_m=(float(middle[0]), float(middle[1])),
            )
        )
    return found


def near_passes(scenario: Scenario) -> list[Finding]:
    """Find pairs of road users that pass each other closely, one of them moving.

    Pairs that overlap at any step are collisions, or recorded so by assumed sizes.
    """
    agents, now = scenario.agents, scenario.current_step
    steps = np.arange(now, scenario.time_axis.num_steps)
    boxes = agents.at_steps(steps)
    radius = boxes.radius_m + NEAR_PASS_M / 2
    pairs = pairs_that_meet(boxes.position_m, boxes.is_valid, radius)
    uses_road = agents.kind_mask(ROAD_USER_KINDS)
    pairs = pairs[_pairs_matter(agents, pairs) & uses_road[pairs].all(axis=1)]
    a, b = pairs.T
    offset = boxes.position_m[a] - boxes.position_m[b]
    moves = agents.speed_mps()[:, steps] >= MOVING_MPS
    near = (
        np.einsum("psd,psd->ps", offset, offset) < (radius[a] + radius[b])[:, None] ** 2
    )
    near &= boxes.is_valid[a] & boxes.is_valid[b]
    pair, at = np.nonzero(near)
    gap = np.full(near.shape, np.inf)
    gap[pair, at] = box_gap_m(boxes.at(a[pair], at), boxes.at(b[pair], at))
    is_near = (gap < NEAR_PASS_M) & (moves[a] | moves[b])
    found = []
    for row in np.flatnonzero(is_near.any(axis=1) & (gap > 0).all(axis=1)).tolist():
        one, two = pairs[row].tolist()
        worst = int(np.where(is_near[row], gap[row], np.inf).argmin())
        least = float(gap[row, worst])
        names = capitalised(agent_name(agents, one)), agent_name(agents, two)
        place = (
            agents.position_m[one, now + worst] + agents.position_m[two, now + worst]
        ) / 2
        found.append(
            Finding(
                kind="near-pass",
                agent_ids=(agents.ids[one], agents.ids[two]),
                spans=spans_of(np.flatnonzero(is_near[row]) + now),
                worst_step=now + worst,
                value=least,
                limit=NEAR_PASS_M,
                headline=f"{agents.ids[one]} and {agents.ids[two]} {least:.2f} m apart",
                message=(
                    f"{names[0]} and {names[1]} pass with {least:.2f} m between them"
                    f" {at_time(scenario, now + worst)}."
                ),
                place_m=(float(place[0]), float(place[1])),
            )
        )
    return found


def later_collisions(
    agents: AgentStates,
) -> tuple[Int[np.ndarray, "P 2"], Int[np.ndarray, "P"]]:
    """Pairs whose collision begins after the first step, counted as in the list.

    Returns their rows, and the step at which each begins.
    """
    pairs, pair, at, _ = _hits(agents, agents)
    moves = _moves(agents.position_m, agents.is_valid)
    hit, first = np.unique(pair, return_index=True)
    counted = (at[first] > 0) & moves[pairs[hit]].any(axis=1)
    return pairs[hit[counted]], at[first[counted]]


def _hits(
    agents: AgentStates, boxes: BoxStates
) -> tuple[
    Int[np.ndarray, "P 2"],
    Int[np.ndarray, "N"],
    Int[np.ndarray, "N"],
    Float[np.ndarray, "N"],
]:
    """Pairs that may overlap; pair, step and shared area of each overlap."""
    pairs = pairs_that_meet(boxes.position_m, boxes.is_valid, boxes.radius_m)
    pairs = pairs[_pairs_matter(agents, pairs)]
    return pairs, *_overlaps(boxes, pairs)


def _overlaps(
    boxes: BoxStates, pairs: Int[np.ndarray, "P 2"]
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Index of the pair, index of the step and shared area of each overlap.

    Sorted by pair, then by step; of very many pairs only the first ones are tested.
    """
    parts, num_found = [], 0
    for start in range(0, len(pairs), _PAIRS_AT_ONCE):
        some = pairs[start : start + _PAIRS_AT_ONCE]
        pair, at = overlaps_of_pairs(some, boxes)
        one, two = (boxes.at(rows, at).corners_m() for rows in some[pair].T)
        parts.append((pair + start, at, overlap_area(one, two)))
        num_found += len(np.unique(pair))
        if num_found >= MAX_COLLISIONS:
            break
    nothing = (np.zeros(0, int), np.zeros(0, int), np.zeros(0))
    columns = zip(nothing, *parts, strict=True)
    pair, at, area = (np.concatenate(column) for column in columns)
    return pair, at, area


def _moves(
    position_m: Float[np.ndarray, "A S 2"], is_valid: Bool[np.ndarray, "A S"]
) -> Bool[np.ndarray, "A"]:
    """Whether each agent moves during the steps."""
    first = np.take_along_axis(
        position_m, is_valid.argmax(axis=1)[:, None, None], axis=1
    )
    distance = np.linalg.norm(position_m - first, axis=-1)
    return np.any(is_valid & (distance > STATIONARY_M), axis=1)


def _pairs_matter(
    agents: AgentStates, pairs: Int[np.ndarray, "P 2"]
) -> Bool[np.ndarray, "P"]:
    uses_road = agents.kind_mask(ROAD_USER_KINDS)
    walks = agents.kind_mask({AgentKind.PEDESTRIAN})
    rides = agents.kind_mask({AgentKind.CYCLIST})
    bicycle = agents.kind_mask({AgentKind.RIDERLESS_BICYCLE})
    a, b = pairs[:, 0], pairs[:, 1]
    pushes = (bicycle[a] & (walks | rides)[b]) | (bicycle[b] & (walks | rides)[a])
    return (uses_road[a] | uses_road[b]) & ~(walks[a] & walks[b]) & ~pushes


def short_times(view: TrafficView, others: Iterable[Finding]) -> list[Finding]:
    """Find agents whose shortest time to collision is critical, at its step.

    Pairs that collide, as the other findings tell, are left out.
    """
    scenario, found = view.scenario, []
    row_of = view.everyone.row_of
    told = np.zeros((len(row_of), len(row_of)), bool)
    for one in others:
        if one.kind in ("collision", "later-collision"):
            pair = [row_of[name] for name in one.agent_ids if name in row_of]
            told[pair, pair[::-1]] = True
    least, at = least_times_s(view, told)
    for row in np.flatnonzero(least < CRITICAL_S).tolist():
        step = scenario.current_step + int(at[row])
        words = f"time to collision {least[row]:.1f} s"
        found.append(
            finding_of_agent(
                scenario,
                "short-time",
                scenario.agents.row_of[view.agents.ids[row]],
                np.array([step]),
                value=float(least[row]),
                limit=CRITICAL_S,
                words=(
                    f" {words}",
                    f"would hit another agent at constant speed: {words}.",
                ),
            )
        )
    return found
