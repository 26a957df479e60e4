"""Problems of guidance terms before a run: contradictions, and what cannot be met.

A term is checked against the paths that its agent could take and against limits of
acceleration; of other traffic, only against agents that stand on each path to a goal.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.guidance.agent_now import AgentNow
from pd_editor.analysis.guidance.blocked_way import blocking_rows
from pd_editor.analysis.guidance.limits import MAX_ACCELERATION_MPS2, MAX_BRAKING_MPS2
from pd_editor.analysis.guidance.pair_checks import (
    Found,
    gap_problems,
    pair_contradictions,
    threat_problems,
    yield_problems,
)
from pd_editor.analysis.guidance.stop_line import crossing
from pd_editor.analysis.metrics.road.off_road import is_off_road
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.guidance_outcome import GuidanceProblem
from pd_editor.scene.guidance_terms import (
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    KeepGap,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
    Threaten,
    YieldTo,
)
from pd_editor.scene.paths.drawn_path import lane_line, path_to_follow
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.scenario import Scenario

_BESIDE_PATH_M: Final = 4.0
"""Distance of a goal from all planned paths at which it counts as unreachable."""
_SHORT_OF_GOAL_M: Final = 0.5
"""Goals may be so much farther than an agent gets."""
_FAR_START_M: Final = 15.0
_GRIP_MPS2: Final = 6.0
"""Lateral acceleration above which a path cannot be followed at the current speed."""


_SAME_PATH_M: Final = 1.0
"""Paths that come as near to a goal as the nearest one, up to this, lead there."""
_MOST_NAMED: Final = 3


def guidance_problems(
    scenario: Scenario,
    terms: Sequence[GuidanceTerm],
    agent_ids: Sequence[str] | None = None,
) -> tuple[GuidanceProblem, ...]:
    """Problems of terms before a run; terms that are off have none.

    ``agent_ids`` are those whose trajectories are generated; None: not known yet.
    """
    found: list[GuidanceProblem] = []
    active = [term for term in terms if term.is_on and term.weight > 0]
    for term in active:
        problems = list(absences(scenario, term, agent_ids))
        check = CHECKS.get(type(term))
        if check is not None and not any(kind == "error" for kind, _ in problems):
            problems += check(term, scenario)
        if isinstance(term, Threaten) and not problems:
            problems += threat_problems(term, scenario, agent_ids)
        if isinstance(term, YieldTo) and not problems:
            problems += yield_problems(term, scenario, agent_ids)
        if isinstance(term, GoalPoint) and not problems:
            problems += _blocked_goal_problems(term, active, scenario)
        problems += _contradictions(term, active, scenario)
        found += [
            GuidanceProblem(term=term, severity=severity, message=message)
            for severity, message in problems
        ]
    return tuple(found)


def infeasible_terms(problems: Iterable[GuidanceProblem]) -> tuple[GuidanceTerm, ...]:
    """Terms with a problem."""
    return tuple(dict.fromkeys(problem.term for problem in problems))


def absences(
    scenario: Scenario, term: GuidanceTerm, agent_ids: Sequence[str] | None
) -> Found:
    """Agents that are gone, not there now, no road users, locked or not generated."""
    agents, now = scenario.agents, scenario.current_step
    for name in term.named_ids:
        row = agents.row_of.get(name)
        if row is None:
            yield "error", f"Agent {name} is gone; remove its {term.name}."
        elif not agents.is_valid[row, now]:
            yield (
                "error",
                f"Agent {name} is not there at t = 0, so its {term.name} has no effect; "
                "choose an agent that is.",
            )
        elif agents.kinds[row] not in ROAD_USER_KINDS:
            yield (
                "error",
                f"Agent {name} is a {agents.kinds[row].in_words} object, so its "
                f"{term.name} has no effect; choose a road user.",
            )
    for name in term.guided_ids:
        if name not in agents.row_of:
            continue
        lock = scenario.locks.get(name)
        if lock is not None and lock.keeps_trajectory:
            yield (
                "error",
                f"The trajectory of agent {name} is locked, so its {term.name} has no "
                "effect; unlock it.",
            )
        elif agent_ids is not None and name not in agent_ids:
            yield (
                "warning",
                f"Agent {name} is not regenerated, so its {term.name} has no effect; "
                "include it in the run.",
            )


def _contradictions(
    term: GuidanceTerm, terms: Sequence[GuidanceTerm], scenario: Scenario
) -> Found:
    """Terms that ask the same agent for something else."""
    for other in terms[: terms.index(term)]:
        yield from pair_contradictions(term, other)
        shared = _shared_agent(term, other)
        if shared is None:
            continue
        if isinstance(term, TargetSpeed) and isinstance(other, TargetSpeed):
            if abs(term.speed_mps - other.speed_mps) > 0.1:
                yield (
                    "warning",
                    f"{shared} is asked for {other.speed_mps:g} and for "
                    f"{term.speed_mps:g} m/s; keep one of the target speeds.",
                )
        elif isinstance(term, GoalPoint) and isinstance(other, GoalPoint):
            if term.at_s == other.at_s and term.point_m != other.point_m:
                yield (
                    "warning",
                    f"{shared} has two goal points at the same time; give one of them "
                    "another time.",
                )
        elif isinstance(term, FollowPath | FollowLane) and isinstance(
            other, FollowPath | FollowLane
        ):
            yield "warning", f"{shared} has two paths to follow; keep one of them."
        pair = {type(term): term, type(other): other}
        speed, limit = pair.get(TargetSpeed), pair.get(SpeedLimit)
        if (
            isinstance(speed, TargetSpeed)
            and isinstance(limit, SpeedLimit)
            and speed.speed_mps > limit.speed_mps
        ):
            yield (
                "warning",
                f"{shared} is asked for {speed.speed_mps:g} m/s above its speed limit "
                f"of {limit.speed_mps:g} m/s; lower one or raise the other.",
            )
        goal, line = pair.get(GoalPoint), pair.get(StopAtLine)
        if (
            isinstance(speed, TargetSpeed)
            and isinstance(line, StopAtLine)
            and speed.speed_mps > 0
        ):
            yield (
                "warning",
                f"{shared} is asked to keep {speed.speed_mps:g} m/s and to stop at a "
                "line; keep one of both.",
            )
        if isinstance(goal, GoalPoint) and goal.agent_id in scenario.agents.row_of:
            (agent,) = _agents_of(goal, scenario)
            if isinstance(limit, SpeedLimit):
                yield from _goal_beyond_limit(goal, limit, agent)
            if isinstance(line, StopAtLine):
                yield from _goal_beyond_line(goal, line, agent)


def _goal_beyond_limit(goal: GoalPoint, limit: SpeedLimit, agent: AgentNow) -> Found:
    """Whether a goal is farther than an agent gets at its speed limit."""
    time_s = agent.duration_s if goal.at_s is None else goal.at_s
    time_s = min(time_s, agent.duration_s)
    # An agent that is faster now brakes to the limit first.
    excess = max(agent.speed_mps - limit.speed_mps, 0.0)
    braking_s = min(excess / MAX_BRAKING_MPS2, time_s)
    most = limit.speed_mps * time_s + excess * braking_s / 2
    distance = float(np.hypot(*(np.array(goal.point_m) - agent.position_m)))
    if distance > most + _SHORT_OF_GOAL_M:
        yield (
            "warning",
            f"The goal of {agent.name} is {distance:.0f} m away, and at its speed limit "
            f"of {limit.speed_mps:g} m/s it gets at most {most:.0f} m far in "
            f"{time_s:.1f} s; move the goal nearer or raise the limit.",
        )


def _goal_beyond_line(goal: GoalPoint, line: StopAtLine, agent: AgentNow) -> Found:
    """Whether the straight way to a goal crosses the line where the agent stops."""
    way = shapely.LineString([agent.position_m, goal.point_m])
    if way.intersects(shapely.LineString(line.line_m)):
        yield (
            "warning",
            f"The goal of {agent.name} lies beyond the line where it stops; remove one "
            "of the two.",
        )


def _shared_agent(one: GuidanceTerm, other: GuidanceTerm) -> str | None:
    """An agent of both terms in words; None if there is none."""
    if not one.guided_ids and not other.guided_ids:
        return "Each agent"
    if not one.guided_ids or not other.guided_ids:
        return f"Agent {(one.guided_ids or other.guided_ids)[0]}"
    shared = [name for name in one.guided_ids if name in other.guided_ids]
    return f"Agent {shared[0]}" if shared else None


def _agents_of(term: GuidanceTerm, scenario: Scenario) -> list[AgentNow]:
    """Agents that a term names and that are there."""
    rows = [scenario.agents.row_of[name] for name in term.guided_ids]
    return [AgentNow(scenario=scenario, row=row) for row in rows]


def _goal_problems(term: GoalPoint, scenario: Scenario) -> Found:
    (agent,) = _agents_of(term, scenario)
    goal = np.array(term.point_m)
    time_s = agent.duration_s if term.at_s is None else term.at_s
    if time_s > agent.duration_s + 1e-6:
        yield (
            "warning",
            f"The goal of {agent.name} is asked for at {time_s:g} s, and trajectories "
            f"last {agent.duration_s:.1f} s; it is aimed at then.",
        )
        time_s = agent.duration_s
    if agent.is_driver and bool(is_off_road(scenario, goal[None])[0]):
        yield (
            "warning",
            f"The goal of {agent.name} is off the road; move it onto the road.",
        )
    along, beside = _nearest(agent.paths_m, goal)
    best = int(beside.argmin())
    if beside[best] > _BESIDE_PATH_M:
        yield (
            "warning",
            f"The goal of {agent.name} is {beside[best]:.0f} m beside all paths that it "
            "could take; move it onto one of them, or draw a path to it.",
        )
        return
    least, most = agent.reach_m(time_s)
    distance = float(along[best])
    if distance > most + 0.5:
        yield (
            "warning",
            f"The goal of {agent.name} is {distance:.0f} m ahead, and it gets at most "
            f"{most:.0f} m far in {time_s:.1f} s; move it nearer.",
        )
    elif distance < least - 0.5:
        yield (
            "warning",
            f"The goal of {agent.name} is {distance:.0f} m ahead, and it needs "
            f"{least:.0f} m to stop from {agent.speed_mps:.1f} m/s; move it further.",
        )


def _blocked_goal_problems(
    term: GoalPoint, terms: Sequence[GuidanceTerm], scenario: Scenario
) -> Found:
    """Whether agents stand on each path to a goal; others with terms may drive away."""
    (agent,) = _agents_of(term, scenario)
    goal = np.array(term.point_m)
    along, beside = _nearest(agent.paths_m, goal)
    leads = beside <= beside.min() + _SAME_PATH_M
    rows = blocking_rows(
        agent,
        agent.paths_m[leads],
        goal,
        along[leads],
        {name for one in terms for name in one.guided_ids},
    )
    if not rows:
        return
    names = [scenario.agents.ids[row] for row in rows[:_MOST_NAMED]]
    one = len(rows) == 1
    who = f"Agent {names[0]} stands" if one else f"Agents {', '.join(names)} stand"
    yield (
        "warning",
        f"{who} on the way of {agent.name} to its goal; put the goal before "
        f"{'it' if one else 'them'}, or move {'it' if one else 'them'} away.",
    )


def _nearest(
    paths_m: Float[np.ndarray, "P M 2"], point_m: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "P"]]:
    """Arc length and distance of the nearest point of each path."""
    gap = np.linalg.norm(paths_m - point_m, axis=-1)
    node = gap.argmin(axis=1)
    every = np.arange(len(paths_m))
    after = np.minimum(node + 1, paths_m.shape[1] - 1)
    before = np.maximum(node - 1, 0)
    course = paths_m[every, after] - paths_m[every, before]
    course /= np.maximum(np.linalg.norm(course, axis=-1, keepdims=True), 1e-9)
    rest = point_m - paths_m[every, node]
    ahead = (rest * course).sum(-1)
    beside = np.abs(course[:, 0] * rest[:, 1] - course[:, 1] * rest[:, 0])
    # Before its first and beyond its last point a path has no side.
    inside = (node > 0) & (node < paths_m.shape[1] - 1) | (np.abs(ahead) < SPACING_M)
    return node * SPACING_M + ahead, np.where(inside, beside, gap[every, node])


def _path_problems(term: FollowPath, scenario: Scenario) -> Found:
    (agent,) = _agents_of(term, scenario)
    yield from _line_problems(agent, np.array(term.points_m), "path")


def _lane_problems(term: FollowLane, scenario: Scenario) -> Found:
    (agent,) = _agents_of(term, scenario)
    line = lane_line(scenario.road_map, term.lane_ids)
    if line is None or len(line) < 2:
        lanes = scenario.road_map.lane_of
        missing = next((one for one in term.lane_ids if one not in lanes), 0)
        yield (
            "error",
            f"Lane {missing}, which {agent.name} should follow, is not on this map; "
            "choose another one.",
        )
        return
    for one, other in zip(term.lane_ids[:-1], term.lane_ids[1:], strict=True):
        lane = scenario.road_map.lane_of[one]
        if other not in (*lane.successors, lane.left_neighbor, lane.right_neighbor):
            yield (
                "warning",
                f"Lane {other} does not follow lane {one}; choose lanes of {agent.name} "
                "that are connected.",
            )
    yield from _line_problems(agent, line, "lane")


def _line_problems(
    agent: AgentNow, line_m: Float[np.ndarray, "N 2"], what: str
) -> Found:
    gap = float(np.linalg.norm(line_m - agent.position_m, axis=-1).min())
    if gap > _FAR_START_M:
        yield (
            "warning",
            f"The {what} of {agent.name} begins {gap:.0f} m away; begin it at the agent.",
        )
    followed = path_to_follow(
        line_m, agent.position_m, agent.heading_rad, agent.speed_mps
    )
    path, length = followed.path, followed.length_m
    if length < 1.0:
        yield (
            "warning",
            f"The {what} of {agent.name} ends behind it; draw it ahead of the agent.",
        )
        return
    if not followed.is_drivable:
        yield (
            "warning",
            f"The {what} of {agent.name} leads sideways or backwards, so it is not "
            "followed; begin it in the agent's direction.",
        )
        return
    turn = np.abs(np.diff(path.heading_rad[0])) / SPACING_M
    driven = agent.reach_m(agent.duration_s)[1] / SPACING_M
    within = np.arange(len(turn)) < min(driven, length / SPACING_M)
    braked = np.maximum(
        agent.speed_mps**2 - 2 * 3.0 * SPACING_M * np.arange(len(turn)), 1.0
    )
    if (braked * turn)[within].max(initial=0.0) > _GRIP_MPS2:
        yield (
            "warning",
            f"The {what} of {agent.name} bends too sharply for {agent.speed_mps:.1f} m/s; "
            "draw a wider curve or lower the speed.",
        )


def _speed_problems(term: TargetSpeed, scenario: Scenario) -> Found:
    for agent in _agents_of(term, scenario):
        change = term.speed_mps - agent.speed_mps
        rate = MAX_ACCELERATION_MPS2 if change > 0 else MAX_BRAKING_MPS2
        if abs(change) > rate * agent.duration_s:
            reached = agent.speed_mps + np.sign(change) * rate * agent.duration_s
            yield (
                "warning",
                f"{agent.subject} drives {agent.speed_mps:.1f} m/s and reaches "
                f"at most {max(reached, 0.0):.1f} m/s in {agent.duration_s:.1f} s, not "
                f"{term.speed_mps:g}; ask for less.",
            )


def _stop_problems(term: StopAtLine, scenario: Scenario) -> Found:
    (agent,) = _agents_of(term, scenario)
    line = np.array(term.line_m)
    found = [crossing(path, line) for path in agent.paths_m]
    places = [(one[0] + one[1]) * SPACING_M for one in found if one is not None]
    if not places:
        yield (
            "warning",
            f"The stop line of {agent.name} crosses none of the paths that it could "
            "take; put it across its lane.",
        )
        return
    length = float(scenario.agents.size_m[agent.row, 0])
    ahead = max(places) - length / 2
    needed = agent.speed_mps**2 / (2 * max(ahead, 0.01))
    if ahead <= 0:
        yield (
            "warning",
            f"The front of {agent.name} is on its stop line already; put the line "
            "further ahead.",
        )
    elif needed > MAX_BRAKING_MPS2:
        yield (
            "warning",
            f"To stop at its line in {ahead:.0f} m, {agent.name} would have to brake with "
            f"{needed:.1f} m/s2 from {agent.speed_mps:.1f} m/s; put the line further "
            "ahead.",
        )


def _limit_problems(term: SpeedLimit, scenario: Scenario) -> Found:
    for agent in _agents_of(term, scenario):
        if agent.speed_mps - term.speed_mps > MAX_BRAKING_MPS2 * agent.duration_s:
            yield (
                "warning",
                f"{agent.subject} drives {agent.speed_mps:.1f} m/s and cannot "
                f"brake to {term.speed_mps:g} m/s in {agent.duration_s:.1f} s.",
            )


CHECKS: Final[dict[type[GuidanceTerm], Callable[[Any, Scenario], Found]]] = {
    GoalPoint: _goal_problems,
    FollowPath: _path_problems,
    FollowLane: _lane_problems,
    TargetSpeed: _speed_problems,
    SpeedLimit: _limit_problems,
    StopAtLine: _stop_problems,
    KeepGap: gap_problems,
}
"""Problems of the terms of each kind, of agents that are there."""
