"""Problems of terms on pairs of agents before a run."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final, Literal, get_args

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.agent_now import AgentNow
from pd_editor.analysis.guidance.limits import MAX_BRAKING_MPS2
from pd_editor.analysis.guidance.pair_outcomes import gaps_ahead
from pd_editor.analysis.threats.threat_feasibility import (
    expected_tracks,
    recorded_track,
    threat_obstacle,
)
from pd_editor.analysis.threats.threat_outcome import OBSTACLES, obstacle_in_words
from pd_editor.analysis.threats.threat_plans import ThreatAim, ThreatObstacle
from pd_editor.scene.guidance_terms import (
    APPROACH_WORDS,
    Approach,
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    KeepGap,
    PairGuidance,
    StopAtLine,
    Threaten,
    YieldTo,
)
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

_SAME_PLACE_M: Final = 2.5
"""Paths that come this close meet."""
_STRIDE: Final = 2
Found = Iterator[tuple[Literal["error", "warning"], str]]


def threat_problems(
    term: Threaten, scenario: Scenario, agent_ids: Sequence[str] | None
) -> Found:
    """Why a threat cannot be carried out, and by which approach it could."""
    if not scenario.time_axis.num_future_steps:
        yield (
            "error",
            "The scenario ends at its current step, so no agent can threaten.",
        )
        return
    ids = () if agent_ids is None else tuple(agent_ids)
    obstacle = _obstacle(scenario, term, ids)
    if obstacle is None:
        return
    others = [
        f'"{words}" ({approach})'
        for approach, words in APPROACH_WORDS.items()
        if approach != term.approach
        and _obstacle(scenario, replace(term, approach=approach), ids) is None
    ]
    aim = ThreatAim.of(term.approach, term.severity)
    goal = "contact" if aim.is_contact else f"a gap of {aim.gap_m:.1f} m"
    advice = (
        f"choose the approach {' or '.join(others)}"
        if others
        else "choose another agent"
    )
    axis = scenario.time_axis
    other, duration_s = f"agent {term.other_id}", axis.num_future_steps * axis.step_s
    why = obstacle_in_words(obstacle, term.approach, other, duration_s)
    yield (
        "error",
        f"Agent {term.agent_id} cannot come to {goal} with agent {term.other_id} "
        f"({APPROACH_WORDS[term.approach]}): {why}; {advice}.",
    )


def approach_obstacles(
    scenario: Scenario, term: Threaten
) -> dict[str, tuple[str, str]]:
    """Why approaches are infeasible, in few words and in a sentence; none of others.

    All other agents keep their trajectories. Empty if an agent is not there.
    """
    agents, now = scenario.agents, scenario.current_step
    rows = [agents.row_of.get(name, -1) for name in term.named_ids]
    if min(rows) < 0 or not agents.is_valid[rows, now].all():
        return {}
    duration_s = scenario.time_axis.num_future_steps * scenario.time_axis.step_s
    found: dict[str, tuple[str, str]] = {}
    for approach in get_args(Approach):
        obstacle = _obstacle(scenario, replace(term, approach=approach), ())
        if obstacle is not None:
            other = f"agent {term.other_id}"
            why = obstacle_in_words(obstacle, approach, other, duration_s)
            found[approach] = (OBSTACLES[obstacle.kind], f"{why[0].upper()}{why[1:]}.")
    return found


@lru_cache(maxsize=256)
def _obstacle(
    scenario: Scenario, term: Threaten, generated_ids: tuple[str, ...]
) -> ThreatObstacle | None:
    """Cached: each sample of a run asks again."""
    (other,) = scenario.agents.rows((term.other_id,))
    is_kept = _is_kept(term, generated_ids)
    tracks = expected_tracks(scenario, int(other), is_kept=is_kept)
    return threat_obstacle(scenario, term, tracks, generated_ids)


def _is_kept(term: PairGuidance, agent_ids: Sequence[str] | None) -> bool:
    """Whether the other agent keeps its trajectory, as it does unless it is generated."""
    return agent_ids is None or term.other_id not in agent_ids


def gap_problems(term: KeepGap, scenario: Scenario) -> Found:
    """Whether named agents stand behind others that stand: they cannot reverse."""
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(term.agent_ids)
    speed = agents.speed_mps()[:, now]
    boxes = agents.at_steps(slice(now, now + 1))
    stands = boxes.is_valid & (speed < STANDING_MPS)[:, None]
    gap, _ = gaps_ahead(boxes, rows)
    standing, _ = gaps_ahead(replace(boxes, is_valid=stands), rows)
    for row, (one,), (other,) in zip(rows, gap, standing, strict=True):
        if stands[row] and one == other < term.gap_m:
            yield (
                "warning",
                f"Agent {agents.ids[row]} stands {one:.1f} m behind an agent that stands "
                f"as well, and cannot reverse to a gap of {term.gap_m:g} m; ask for less "
                "or name agents that drive.",
            )


def yield_problems(
    term: YieldTo, scenario: Scenario, agent_ids: Sequence[str] | None
) -> Found:
    """Whether the paths of two agents meet, and whether one can wait before that."""
    rows = scenario.agents.rows((term.agent_id, term.other_id)).tolist()
    agent, other = (AgentNow(scenario=scenario, row=row) for row in rows)
    if _is_kept(term, agent_ids):
        theirs = recorded_track(scenario, other.row).position_m[None]
    else:
        theirs = driven_paths_m(other)
    places = _meeting_places_m(driven_paths_m(agent), theirs)
    if not len(places):
        yield (
            "warning",
            f"The paths of {agent.name} and {other.name} do not meet; choose another "
            "agent to yield to.",
        )
        return
    length = float(scenario.agents.size_m[agent.row, 0])
    room = float(places.max()) - length
    needed = agent.speed_mps**2 / (2 * max(room, 0.01))
    if room <= 0 and agent.speed_mps > 0:
        yield (
            "warning",
            f"{agent.subject} is where the paths meet already, so it cannot let "
            f"{other.name} pass; remove the term.",
        )
    elif needed > MAX_BRAKING_MPS2:
        yield (
            "warning",
            f"To let {other.name} pass, {agent.name} would have to brake with "
            f"{needed:.1f} m/s2 in {room:.0f} m from {agent.speed_mps:.1f} m/s; choose "
            "the other one to yield.",
        )


def driven_paths_m(agent: AgentNow) -> Float[np.ndarray, "P N 2"]:
    """The parts of an agent's paths that it could drive."""
    most = int(agent.reach_m(agent.duration_s)[1] / SPACING_M) + 1
    return agent.paths_m[:, :most:_STRIDE]


def _meeting_places_m(
    mine_m: Float[np.ndarray, "P N 2"], theirs_m: Float[np.ndarray, "Q M 2"]
) -> Float[np.ndarray, "K"]:
    """Arc lengths at which each path of an agent first meets each of the other's."""
    places: list[float] = []
    for path in mine_m:
        gap = path[:, None, None] - theirs_m
        meets = ((gap**2).sum(-1) < _SAME_PLACE_M**2).any(axis=2)
        first = meets.argmax(axis=0)[meets.any(axis=0)]
        places += (first * _STRIDE * SPACING_M).tolist()
    return np.array(places)


def pair_contradictions(term: GuidanceTerm, other: GuidanceTerm) -> Found:
    """Terms on the same two agents that exclude each other."""
    if isinstance(term, YieldTo) and isinstance(other, YieldTo):
        if (term.agent_id, term.other_id) == (other.other_id, other.agent_id):
            yield (
                "warning",
                f"Agents {term.agent_id} and {term.other_id} yield to each other; keep "
                "one of both terms.",
            )
    elif isinstance(term, Threaten) and isinstance(other, Threaten):
        if term.agent_id == other.agent_id:
            yield (
                "warning",
                f"Agent {term.agent_id} threatens two agents; keep one of the threats.",
            )
        elif term.agent_id == other.other_id or term.other_id == other.agent_id:
            both = term.agent_id if term.agent_id == other.other_id else term.other_id
            yield (
                "warning",
                f"Agent {both} threatens another agent and is threatened, which leaves "
                "it unchanged; keep one of the threats.",
            )
    for threat, one in ((term, other), (other, term)):
        if (
            isinstance(threat, Threaten)
            and isinstance(
                one, GoalPoint | FollowPath | FollowLane | StopAtLine | YieldTo
            )
            and threat.agent_id == one.agent_id
        ):
            yield (
                "warning",
                f"Agent {one.agent_id} threatens another agent, which decides its "
                f"trajectory, so its {one.name} may not be met; keep one of both terms.",
            )
