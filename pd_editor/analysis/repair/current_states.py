"""Current states of the agents that a repair may change, and poses that they can slide to."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_collide
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.frenet import FrenetFrames
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.geometry.polyline import without_repeats
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import (
    MAX_TURN_RAD,
    METRES_PER_RADIAN,
    lane_kinds_of,
)
from pd_editor.scene.scenario import Scenario

_PUSHED_WITH: Final = frozenset({AgentKind.PEDESTRIAN, AgentKind.RIDERLESS_BICYCLE})
"""Kinds that cyclists overlap in recordings, when they get on or off."""


def repairable(
    scenario: Scenario,
    agent_ids: Iterable[str] | None,
    kinds: Collection[AgentKind] = LANE_FOLLOWER_KINDS,
    *,
    keeps_beginnings: bool = False,
) -> Bool[np.ndarray, "A"]:
    """Which agents may be repaired: present ones of ``kinds`` in ``agent_ids`` (None: all).

    Locked agents are left out; if the repair keeps the beginnings of trajectories, only
    those with a locked trajectory.

    Raises:
        EditError: an id is not in the scenario.
    """
    agents = scenario.agents
    asked = np.zeros(len(agents), bool)
    asked[agents.rows(agents.ids if agent_ids is None else agent_ids)] = True
    asked[
        agents.rows(
            name
            for name, lock in scenario.locks.items()
            if lock.keeps == "trajectory" or not keeps_beginnings
        )
    ] = False
    return asked & agents.kind_mask(kinds) & agents.is_valid[:, scenario.current_step]


def counted(
    agents: AgentTracks, pairs: Int[np.ndarray, "P 2"]
) -> Bool[np.ndarray, "P"]:
    """Whether pairs are to be separated: pairs with at least one lane follower.

    Pairs of a cyclist and a pedestrian or riderless bicycle are left out.
    """
    follows = agents.kind_mask(LANE_FOLLOWER_KINDS)[pairs]
    cycles = agents.kind_mask([AgentKind.CYCLIST])[pairs]
    pushed = agents.kind_mask(_PUSHED_WITH)[pairs]
    return np.any(follows, axis=1) & ~(np.any(cycles, axis=1) & np.any(pushed, axis=1))


SLIDE_REACH_M: Final = 20.0
"""Largest distance that an agent slides, forwards or backwards."""
SLIDE_STEP_M: Final = 0.25


def slides_m() -> Float[np.ndarray, "K"]:
    """Distances to slide, sorted by size; backwards first among equals."""
    count = round(SLIDE_REACH_M / SLIDE_STEP_M)
    steps = np.repeat(np.arange(1, count + 1), 2) * SLIDE_STEP_M
    return steps * np.tile([-1.0, 1.0], count)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneChoice:
    """Assigned lane of each of N agents."""

    lane: Int[np.ndarray, "N"]
    """Row in the lane graph; -1 without a lane in reach in the agent's direction."""
    distance_m: Float[np.ndarray, "N"]
    """Distance to the nearest lane in the agent's direction; infinite without one."""
    along_m: Float[np.ndarray, "N"]
    """Arc length of each agent on its lane."""


def line_through(graph: LaneGraph, lane: int) -> tuple[FrenetFrames, float]:
    """Frame of a lane with its predecessors and successors, and the lane's start in it.

    The straightest lanes are used in both directions, as far as an agent may slide.
    """
    behind, ahead, before = [lane], [lane], 0.0
    while before < SLIDE_REACH_M:
        leading = [
            row for row, after in enumerate(graph.successors) if behind[0] in after
        ]
        new = [row for row in leading if row not in behind]
        if not new:
            break
        behind.insert(
            0, min(new, key=lambda row: graph.successors[row].index(behind[0]))
        )
        before += float(graph.lengths_m[behind[0]])
    length = float(graph.lengths_m[lane])
    total = length
    while total < length + SLIDE_REACH_M:
        new = [row for row in graph.successors[ahead[-1]] if row not in ahead]
        if not new:
            break
        ahead.append(new[0])
        total += float(graph.lengths_m[new[0]])
    lines = [graph.centerlines_m[row] for row in (*behind, *ahead[1:])]
    points = without_repeats(np.concatenate(lines), 1e-3)
    frames = FrenetFrames(points_m=points[None])
    earlier = without_repeats(
        np.concatenate([*lines[: len(behind) - 1], lines[len(behind) - 1][:1]]), 1e-3
    )
    return frames, float(np.linalg.norm(np.diff(earlier, axis=0), axis=-1).sum())


def poses_along(
    frames: FrenetFrames,
    s_m: Float[np.ndarray, "K"],
    d_m: float,
) -> tuple[Float[np.ndarray, "K 2"], Float[np.ndarray, "K"], Bool[np.ndarray, "K"]]:
    """Positions at an offset from a line, headings there, and whether they are on it.

    Beyond the line's ends poses continue straight.
    """
    places = np.stack([s_m - 0.5, s_m, s_m + 0.5])
    ends = frames.to_plane(places[::2].reshape(1, -1), np.zeros((1, 2 * len(s_m))))
    back, on = ends[0].reshape(2, -1, 2)
    position = frames.to_plane(s_m[None], np.full((1, len(s_m)), d_m))[0]
    is_there = (s_m >= 0) & (s_m <= frames.along_m[0, -1])
    return position, heading_of(on - back), is_there


def slid_poses(
    graph: LaneGraph,
    lane: int,
    position_m: Float[np.ndarray, "2"],
    heading_rad: float,
    slide_m: Float[np.ndarray, "K"],
) -> tuple[Float[np.ndarray, "M 2"], Float[np.ndarray, "M"]]:
    """Poses at distances along a lane, with constant offset and angle to it.

    Poses beyond the lane's line are left out. Without a lane (-1) agents move straight.
    """
    if lane < 0:
        direction = unit_vector(heading_rad)
        position = position_m + slide_m[:, None] * direction
        return position, np.full(len(slide_m), heading_rad)
    frames, _ = line_through(graph, lane)
    s, d = frames.to_frenet(position_m[None, None])
    here = float(s[0, 0])
    position, heading, is_there = poses_along(
        frames, np.append(here, here + slide_m), float(d[0, 0])
    )
    new_heading = wrap_angle(heading_rad + heading[1:] - heading[0])
    return position[1:][is_there[1:]], new_heading[is_there[1:]]


@dataclass(kw_only=True, eq=False)
class States:
    """Poses of all A agents at the current step; repairs write into them."""

    scenario: Scenario
    position_m: Float[np.ndarray, "A 2"]
    heading_rad: Float[np.ndarray, "A"]
    exists: Bool[np.ndarray, "A"]

    @classmethod
    def of(cls, scenario: Scenario) -> "States":
        """Copy the current poses of a scenario."""
        agents, step = scenario.agents, scenario.current_step
        return cls(
            scenario=scenario,
            position_m=agents.position_m[:, step].copy(),
            heading_rad=agents.heading_rad[:, step].copy(),
            exists=agents.is_valid[:, step],
        )

    @property
    def graph(self) -> LaneGraph:
        """Lanes of the road."""
        return lane_graph(self.scenario.road_map)

    def lanes(self, rows: Int[np.ndarray, "N"], reach_m: float) -> LaneChoice:
        """Assign agents the best lanes by distance and angle, within ``reach_m``."""
        graph, count = self.graph, len(rows)
        lane, along = np.full(count, -1), np.zeros(count)
        distance = np.full(count, np.inf)
        if count and graph.lane_ids:
            kinds = self.scenario.agents.kinds
            usable = [graph.allowed(lane_kinds_of(kinds[row])) for row in rows]
            near = graph.search.in_reach(
                self.position_m[rows], self.heading_rad[rows], np.array(usable), reach_m
            )
            turn = np.abs(near.turn_rad)
            cost = near.distance_m + METRES_PER_RADIAN * turn
            order = np.lexsort((near.lane, cost.round(6), near.point))
            first = order[np.diff(near.point[order], prepend=-1) != 0]
            lane[near.point[first]] = near.lane[first]
            along[near.point[first]] = near.along_m[first]
            good = turn <= MAX_TURN_RAD
            np.minimum.at(distance, near.point[good], near.distance_m[good])
        return LaneChoice(lane=lane, distance_m=distance, along_m=along)

    def num_overlaps(
        self,
        row: int,
        position_m: Float[np.ndarray, "K 2"],
        heading_rad: Float[np.ndarray, "K"],
        gap_m: float = 0.0,
    ) -> Int[np.ndarray, "K"]:
        """Number of agents that one would overlap at K poses, with a gap ahead and behind."""
        agents = self.scenario.agents
        boxes = Boxes(
            position_m=position_m[:, None],
            heading_rad=heading_rad[:, None],
            size_m=agents.size_m[row] + np.array([2 * gap_m, 0.0]),
        )
        low, high = position_m.min(axis=0), position_m.max(axis=0)
        apart = np.maximum(low - self.position_m, self.position_m - high).max(axis=1)
        near = self.exists & (apart < agents.radius_m + boxes.radius_m.max())
        near[row] = False
        others = Boxes(
            position_m=self.position_m,
            heading_rad=self.heading_rad,
            size_m=agents.size_m,
        )
        return boxes_collide(boxes, others[near]).sum(axis=1)

    def first_free(
        self,
        row: int,
        position_m: Float[np.ndarray, "K 2"],
        heading_rad: Float[np.ndarray, "K"],
        *,
        max_overlaps: int = 0,
        gap_m: float = 0.0,
    ) -> int | None:
        """Index of the first acceptable pose of an agent; None if there is none.

        An acceptable pose has at most ``max_overlaps`` overlaps, is not further from a
        lane than now, and is not off the road if the agent is on the road now.
        """
        start = 0
        # Poses are tested in chunks, since one of the first is usually free.
        for end in (24, 72, len(position_m)):
            some = slice(start, end)
            start = end
            if not len(position_m[some]):
                break
            number = self.num_overlaps(row, position_m[some], heading_rad[some], gap_m)
            free = np.flatnonzero(number <= max_overlaps) + some.start
            if len(free) == 0:
                continue
            sound = self.is_no_worse(row, position_m[free])
            if sound.any():
                return int(free[sound.argmax()])
        return None

    def is_no_worse(
        self, row: int, position_m: Float[np.ndarray, "K 2"]
    ) -> Bool[np.ndarray, "K"]:
        """Whether positions are as near to a lane, and as much on the road, as now."""
        both = np.concatenate([self.position_m[row][None], position_m])
        kinds = lane_kinds_of(self.scenario.agents.kinds[row])
        off_lane = nearest_lanes(self.scenario.road_map, both, kinds=kinds).distance_m
        off_road = is_off_road(self.scenario, both)
        return (off_lane[1:] <= off_lane[0] + 1e-6) & (off_road[0] | ~off_road[1:])

    def carried(self) -> Scenario:
        """Scenario with whole tracks moved rigidly to the new poses."""
        scenario = self.scenario
        agents, step = scenario.agents, scenario.current_step
        turn = wrap_angle(self.heading_rad - agents.heading_rad[:, step])
        moved = (self.position_m != agents.position_m[:, step]).any(axis=1)
        rows = np.flatnonzero((moved | (turn != 0)) & self.exists)
        if len(rows) == 0:
            return scenario
        agents = agents.carried(rows, step, self.position_m[rows], turn[rows])
        heading = agents.heading_rad[rows]
        heading[:, step] = self.heading_rad[rows]
        return scenario.with_agents(agents.with_rows(rows, heading_rad=heading))
