"""Frenet candidates: possible trajectories of each agent over the next seconds.

After Path Diffuser (Lee et al., section III-D): reference lanes, a grid of speeds and
of lateral offsets. Here target speeds are relative to the current speed, curves limit
them, constant speed and standstill are always included, and duplicates are removed.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.paths.candidate_grid import (
    FOLLOWING,
    SPEED_PLANS,
    PlannedPaths,
    Role,
    Start,
    leaders,
    plan_paths,
    targets,
    turns,
)
from pd_editor.scene.paths.car_following import BoxesAhead
from pd_editor.scene.paths.driving_paths import velocity_of
from pd_editor.scene.paths.retiming import drive
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

SAME_M: Final = 0.3
"""Candidates closer than this half way and at the end are duplicates."""
_FAR_M: Final = 1e9


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateSet:
    """C candidates of each of A agents at H steps, the first one the current step.

    Candidates are sorted, the most natural first; fields are 0 where ``is_valid`` is
    false.
    """

    position_m: Float[np.ndarray, "A C H 2"]
    heading_rad: Float[np.ndarray, "A C H"]
    velocity_mps: Float[np.ndarray, "A C H 2"]
    is_valid: Bool[np.ndarray, "A C"]
    lane_ids: tuple[tuple[tuple[int, ...], ...], ...]
    """Lanes of the route of each valid candidate, per agent; none off the lanes."""
    target_speed_mps: Float[np.ndarray, "A C"]
    lateral_shift_m: Float[np.ndarray, "A C"]
    """Final minus initial offset from the route; positive to the left."""
    beyond_lanes_m: Float[np.ndarray, "A C"]
    """Length driven straight on beyond the end of the map's lanes."""
    is_standstill: Bool[np.ndarray, "A C"]
    """Whether the agent stays stationary, or brakes to a standstill."""
    is_lane_change: Bool[np.ndarray, "A C"]
    has_lane: Bool[np.ndarray, "A"]
    """False for agents that follow no lane: too far from lanes, or of another kind."""


def candidates(
    scenario: Scenario, rows: np.ndarray, *, max_candidates: int = 32
) -> CandidateSet:
    """Candidates of the agents at ``rows``, each from its state at the current step.

    They depend on the map and the agent's own state only: none follows the agent
    ahead. Agents that do not exist at that step have none.
    """
    axis = scenario.time_axis
    chosen = _Chosen.of(
        scenario,
        rows,
        max_candidates,
        num_steps=axis.num_future_steps,
        step_s=axis.step_s,
        knows_leaders=False,
    )
    return _packed(chosen, axis.step_s, max_candidates)


def candidate_positions(
    scenario: Scenario,
    rows: np.ndarray,
    *,
    max_candidates: int,
    num_steps: int,
    step_s: float,
    knows_leaders: bool,
) -> tuple[
    Float[np.ndarray, "N {num_steps}+1 2"],
    Int[np.ndarray, "N"],
    Int[np.ndarray, "N"],
]:
    """Positions of the valid ``candidates`` over a given number of steps.

    Also returns each candidate's agent, as index into ``rows``, and its slot among the
    agent's candidates. The scenario's time axis is not used. With ``knows_leaders``,
    each route, and the straight path off the lanes, has one more candidate: it follows
    the present leader, which keeps its speed.
    """
    chosen = _Chosen.of(
        scenario,
        rows,
        max_candidates,
        num_steps=num_steps,
        step_s=step_s,
        knows_leaders=knows_leaders,
    )
    position = chosen.plans.paths.position_at(chosen.path, chosen.reached_m)
    position[:, 0] = chosen.start.position_m[chosen.agent]
    return position, chosen.agent, chosen.slot


@dataclass(frozen=True, kw_only=True, eq=False)
class _Chosen:
    """The N candidates without duplicates."""

    start: Start
    plans: PlannedPaths
    path: Int[np.ndarray, "N"]
    slot: Int[np.ndarray, "N"]
    """Index among the agent's candidates."""
    stands: Bool[np.ndarray, "N"]
    reached_m: Float[np.ndarray, "N H"]
    target_mps: Float[np.ndarray, "N"]

    @property
    def agent(self) -> Int[np.ndarray, "N"]:
        return self.plans.agent[self.path]

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        rows: np.ndarray,
        most: int,
        *,
        num_steps: int,
        step_s: float,
        knows_leaders: bool,
    ) -> "_Chosen":
        assert most >= 2, "own speed and standstill are always among them"
        rows = np.asarray(rows, int)
        start = Start.of(scenario, rows)
        plans = plan_paths(scenario.road_map, start, num_steps * step_s)
        leader = np.full(len(plans.agent), -1)
        ahead = leaders(scenario, rows, plans) if knows_leaders else None
        if ahead is not None:
            leader[ahead.driver] = np.arange(len(ahead.driver))
        path, plan = turns(plans, start.exists, 2 * most, leader >= 0)
        target = targets(start.speed_mps[plans.agent[path]], plan)
        if ahead is not None:
            follows = np.flatnonzero(plan == FOLLOWING)
            index = leader[path[follows]]
            # A stationary agent starts behind a leader that drives.
            ahead = BoxesAhead(
                driver=follows,
                gap_m=ahead.gap_m[index],
                speed_mps=np.maximum(ahead.speed_mps[index], 0.0),
            )
            target[follows] = np.maximum(target[follows], ahead.speed_mps)
        reached = drive(
            plans.paths,
            path,
            speed_mps=start.speed_mps[plans.agent[path]],
            target_mps=target,
            most_mps2=np.array(
                [(one.acceleration_mps2, one.braking_mps2) for one in SPEED_PLANS]
            )[plan].T,
            num_steps=num_steps,
            step_s=step_s,
            leaders=ahead,
        )
        kept, slot, stands = _distinct(
            plans.agent[path],
            plans.paths.position_at(path, reached[:, [reached.shape[1] // 2, -1]]),
            target == 0.0,
            (len(start.kinds), most),
        )
        return cls(
            start=start,
            plans=plans,
            path=path[kept],
            slot=slot,
            stands=stands,
            reached_m=reached[kept],
            target_mps=target[kept],
        )


def _distinct(
    agent: Int[np.ndarray, "K"],
    marks_m: Float[np.ndarray, "K 2 2"],
    stands: Bool[np.ndarray, "K"],
    shape: tuple[int, int],
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"], Bool[np.ndarray, "N"]]:
    """Remove duplicates: indices of kept candidates, their slots, and which stand.

    ``marks_m`` are the points that are compared. A kept candidate is a standstill also
    if one of its duplicates is.
    """
    num_agents, most = shape
    rank = np.arange(len(agent)) - np.searchsorted(agent, agent)
    tries = int(rank.max(initial=-1)) + 1
    table = np.full((num_agents, tries, 4), _FAR_M)
    table[agent, rank] = marks_m.reshape(-1, 4)
    gap = np.zeros((2, num_agents, tries, tries))
    for axis in range(4):
        values = table[..., axis]
        gap[axis // 2] += (values[:, :, None] - values[:, None, :]) ** 2
    same = np.maximum(gap[0], gap[1]) < SAME_M**2
    exists = table[..., 0] < _FAR_M
    kept = np.zeros((num_agents, tries), bool)
    for index in range(tries):
        seen = (same[:, index, :index] & kept[:, :index]).any(1)
        kept[:, index] = exists[:, index] & ~seen
    kept &= np.cumsum(kept, axis=1) <= most
    standing = np.zeros((num_agents, tries), bool)
    standing[agent, rank] = stands
    standing = (same & standing[:, None]).any(2)[agent, rank]
    chosen = kept[agent, rank]
    slot = (np.cumsum(kept, axis=1) - 1)[agent, rank]
    return np.flatnonzero(chosen), slot[chosen], standing[chosen]


def _packed(chosen: _Chosen, step_s: float, max_candidates: int) -> CandidateSet:
    start, plans, path = chosen.start, chosen.plans, chosen.path
    reached_m, slot = chosen.reached_m, chosen.slot
    agent, route = chosen.agent, plans.route[path]
    shape = (len(start.kinds), max_candidates)

    def placed(values: np.ndarray) -> np.ndarray:
        table = np.zeros((*shape, *values.shape[1:]), values.dtype)
        table[agent, slot] = values
        return table

    position, heading = plans.paths.pose_at(path, reached_m)
    position[:, 0] = start.position_m[agent]
    velocity = velocity_of(position, start.velocity_mps[agent], step_s)
    heading[:, 0] = start.heading_rad[agent]
    choice = plans.choice
    lanes: list[list[tuple[int, ...]]] = [[] for _ in start.kinds]
    for index, one in zip(agent.tolist(), route.tolist(), strict=True):
        lanes[index].append(choice.routes[one].lane_ids if one >= 0 else ())
    return CandidateSet(
        position_m=placed(position),
        heading_rad=placed(heading),
        velocity_mps=placed(velocity),
        is_valid=placed(np.ones(len(path), bool)),
        lane_ids=tuple(map(tuple, lanes)),
        target_speed_mps=placed(chosen.target_mps),
        lateral_shift_m=placed(plans.shift_m[path]),
        beyond_lanes_m=placed(plans.beyond_lanes_m(path, reached_m[:, -1:])[:, 0]),
        is_standstill=placed(chosen.stands),
        is_lane_change=placed(plans.role[path] == Role.CHANGE),
        has_lane=np.isin(np.arange(shape[0]), choice.agent),
    )


STRAIGHT_RAD: Final = np.radians(20.0)
"""A smaller change of heading counts as straight on."""
U_TURN_RAD: Final = np.radians(150.0)
SAME_SPEED_MPS: Final = 0.4
SHIFT_M: Final = 0.2
"""Smaller changes of the offset from the lane are not mentioned."""


def candidate_texts(found: CandidateSet, road_map: RoadMap) -> tuple[str, ...]:
    """Describe each valid candidate of the first agent.

    Texts that would be equal also name the length of the candidate.
    """
    valid = np.flatnonzero(found.is_valid[0])
    texts = [
        f"{_route(found, i, road_map)}, {_speed(found, i)}" for i in valid.tolist()
    ]
    counts = Counter(texts)
    length = np.linalg.norm(np.diff(found.position_m[0, valid], axis=1), axis=-1).sum(1)
    texts = [
        f"{text} ({metres:.0f} m)" if counts[text] > 1 else text
        for text, metres in zip(texts, length, strict=True)
    ]
    seen: Counter[str] = Counter()
    unique = []
    counts = Counter(texts)
    for text in texts:
        seen[text] += 1
        is_alone = counts[text] == 1
        unique.append(text if is_alone else f"{text}, way {seen[text]}")
    return tuple(unique)


def _route(found: CandidateSet, index: int, road_map: RoadMap) -> str:
    heading = found.heading_rad[0, index]
    turn = float(wrap_angle(np.diff(heading)).sum())
    shift = float(found.lateral_shift_m[0, index])
    side = "left" if shift > 0 else "right"
    if found.is_lane_change[0, index]:
        return f"Change to the {side} lane"
    if abs(turn) >= U_TURN_RAD:
        way = "U-turn"
    elif abs(turn) >= STRAIGHT_RAD:
        way = "Left" if turn > 0 else "Right"
        place = _turns_at_junction(found, index, road_map)
        way += " at the junction" if place else " along the bend"
    else:
        way = "Straight on"
    if abs(shift) > SHIFT_M:
        way += f", {abs(shift):.1f} m to the {side}"
    return way


def _turns_at_junction(found: CandidateSet, index: int, road_map: RoadMap) -> bool:
    """Whether a candidate drives along a lane in a junction."""
    position = found.position_m[0, index]
    for lane_id in found.lane_ids[0][_slot(found, index)]:
        lane = road_map.lane_of.get(lane_id)
        if lane is not None and lane.is_intersection:
            gap = np.linalg.norm(position[:, None] - lane.centerline_m, axis=-1)
            if gap.min() < _ON_LANE_M:
                return True
    return False


_ON_LANE_M: Final = 2.5


def _slot(found: CandidateSet, index: int) -> int:
    """Index of a candidate into ``lane_ids``, which holds the valid ones only."""
    return int(found.is_valid[0, :index].sum())


def _speed(found: CandidateSet, index: int) -> str:
    speed: Float[np.ndarray, "H"] = np.hypot(*found.velocity_mps[0, index].T)
    start, end = float(speed[0]), float(speed[-1])
    if found.is_standstill[0, index]:
        return "standing" if start < STANDING_MPS else "slowing to stop"
    if end > start + SAME_SPEED_MPS:
        return f"speeding up to {end:.1f} m/s"
    if end < start - SAME_SPEED_MPS:
        return f"slowing to {end:.1f} m/s"
    return f"{end:.1f} m/s"
