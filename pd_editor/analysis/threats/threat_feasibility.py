"""Feasibility of threats before a run, from candidates and limits."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.analysis.threats.encounter import Track
from pd_editor.analysis.threats.threat_plans import (
    ThreatAim,
    ThreatObstacle,
    threat_plans,
)
from pd_editor.scene.paths.lasting_tracks import lasting
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

_AWAY_M: Final = 1e6
_NUM_EXPECTED: Final = 3
"""Candidates that stand for a trajectory that is not known yet."""


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
    slots = np.flatnonzero(found.is_valid[0])[:_NUM_EXPECTED]
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
        found.append(
            replace(track, position_m=np.where(there, track.position_m, _AWAY_M))
        )
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
