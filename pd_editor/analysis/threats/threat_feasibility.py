"""Feasibility of threats before a run, and what came of them, in words."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.analysis.threats.encounter import Approach, Encounter, Track
from pd_editor.analysis.threats.threat_plans import (
    GAP_TOLERANCE_M,
    HARD_BRAKING_MPS2,
    ThreatAim,
    ThreatObstacle,
    threat_plans,
)
from pd_editor.scene.paths.lasting_tracks import lasting
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

_COURSES: Final[Mapping[Approach, str]] = {
    "rear": "none of the ways that it could take leads on behind {other}",
    "cut-in": "it would have to come from beside the way of {other}, in the same "
    "direction, and {other} would have to drive",
    "side": "none of the ways that it could take crosses that of {other}",
    "head-on": "none of the ways that it could take leads towards {other}",
    "brakes": "it would have to drive ahead of {other}, on its way, with none between",
    "pulls-out": "it would have to stand beside the way of {other}, ahead of it, and "
    "{other} would have to drive",
}
"""What an approach needs and no candidate has."""
OBSTACLES: Final[Mapping[str, str]] = {
    "course": "no way to that",
    "limits": "too hard",
    "road": "off the road",
    "outcome": "not at this gap",
    "traffic": "the way is blocked",
}
"""Kinds of obstacles in few words."""


def expected_tracks(
    scenario: Scenario, row: int, *, is_kept: bool = False
) -> tuple[Track, ...]:
    """Trajectories that an agent may have: the one it has, and natural candidates.

    With ``is_kept`` only the one it has.
    """
    agents = scenario.agents
    known = recorded_track(scenario, row)
    if is_kept:
        return (known,)
    found = candidates(scenario, np.array([row]), max_candidates=8)
    # Candidates that stand for a trajectory that is not known yet.
    slots = np.flatnonzero(found.is_valid[0])[:3]
    size = agents.size_m[row]
    return known, *(Track.of(found, (0, slot), size) for slot in slots)


def recorded_track(scenario: Scenario, row: int) -> Track:
    """Trajectory that an agent has in the scenario from the current step on, to the end."""
    agents = lasting(scenario, (scenario.agents.ids[row],)).agents
    now = scenario.current_step
    return Track.of(agents, (row, slice(now, None)), agents.size_m[row])


def tracks_in_the_way(
    scenario: Scenario, but: Collection[int], generated_ids: Collection[str] = ()
) -> tuple[Track, ...]:
    """The other agents that do not make way: kept ones, and generated ones that stand.

    Kept agents move as recorded, and are far away where they are not there. Generated
    ones that stand now are taken to go on to do so.
    """
    agents, now = scenario.agents, scenario.current_step
    is_kept = np.array([name not in generated_ids for name in agents.ids], bool)
    stands = agents.speed_mps()[:, now] < STANDING_MPS
    counts = agents.is_valid[:, now] & (is_kept | stands)
    counts[list(but)] = False
    steps = np.where(is_kept[:, None], np.arange(now, agents.num_steps), now)
    found: list[Track] = []
    for row in np.flatnonzero(counts):
        there = agents.is_valid[row, steps[row], None]
        track = Track.of(agents, (row, steps[row]), agents.size_m[row])
        found.append(replace(track, position_m=np.where(there, track.position_m, 1e6)))
    return tuple(found)


def threat_obstacle(
    scenario: Scenario,
    agent_ids: Sequence[str],
    aim: ThreatAim,
    tracks: Sequence[Track] = (),
    generated_ids: Collection[str] = (),
) -> ThreatObstacle | None:
    """What is in the way of a threat of one agent to another; None if it is feasible.

    It is if most of the trajectories that the threatened agent may have, by default the
    one that it has, can be reached, past agents that do not make way. Both agents have
    to be there at the current step.
    """
    row, other = scenario.agents.rows(agent_ids).tolist()
    tracks = tracks or (recorded_track(scenario, other),)
    kept = tracks_in_the_way(scenario, (row, other), generated_ids)
    obstacles = [
        threat_plans(scenario, row, track, aim, kept=kept, most=1).obstacle
        for track in tracks
    ]
    found = [one for one in obstacles if one is not None]
    return found[0] if len(found) * 2 >= len(obstacles) else None


def meets(aim: ThreatAim, found: Encounter) -> bool:
    """Whether an encounter is the asked near-miss or contact."""
    if aim.approach == "brakes" and found.braking_mps2 < HARD_BRAKING_MPS2:
        return False
    if aim.is_contact:
        return found.is_contact
    error = abs(found.counted_gap_m - aim.gap_m)
    return not found.is_contact and error <= GAP_TOLERANCE_M


def encounter_in_words(found: Encounter, approach: Approach) -> str:
    """Gap or contact, side, relative speed, braking and least time to collision."""
    what = "contact" if found.is_contact else f"gap {found.gap_m:.1f} m"
    parts = [
        f"{what} at the {found.side} after {found.at_s:.1f} s",
        f"relative speed {found.relative_speed_mps:.1f} m/s",
    ]
    if approach == "brakes":
        parts.append(f"braking {found.braking_mps2:.1f} m/s²")
    time = found.least_time_to_collision_s
    if time is not None and not found.is_contact:
        parts.append(f"time to collision {time:.1f} s")
    return ", ".join(parts)


def obstacle_in_words(
    obstacle: ThreatObstacle, approach: Approach, other: str, duration_s: float
) -> str:
    """Why a threat cannot be carried out, after the name of the agent."""
    times = obstacle.times_limits
    if obstacle.kind == "course":
        return _COURSES[approach].format(other=other)
    if obstacle.kind == "road":
        return "each way to that leads off the road"
    if obstacle.kind == "outcome":
        return f"each of its ways passes {other} with another gap or hits it otherwise"
    if obstacle.kind == "traffic":
        return "on each of its ways it would hit an agent that does not make way"
    if np.isinf(times):
        return "it would have to turn round or reverse"
    hard = (
        # Times of the limits from which on the number tells nothing.
        f"{np.ceil(10 * times) / 10:.1f}" if times < 10.0 else "far more than 10"
    )
    return (
        f"within {duration_s:.1f} s it would have to accelerate, brake or turn {hard} "
        "times as hard as it can"
    )
