"""Motion by places, the lanes followed (the likeliest sequence), and thresholds."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.lib.stride_tricks import sliding_window_view

from pd_editor.analysis.metrics.lanes import usable_lanes
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS
from pd_editor.scene.agent_states import MOTION, AgentStates
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import (
    MOVING_MPS,
    PARKED_OFFSET_M,
    PARKED_TURN_RAD,
    STANDING_MPS,
)


@dataclass(frozen=True, kw_only=True)
class ManoeuvreLimits:
    """Thresholds; those without a source were chosen by eye on ``train``."""

    sampling_s: float = 0.2
    """Manoeuvres last seconds, so every second step of 10 Hz is enough."""
    jump_rad: float = 1.0
    """No vehicle yaws more in a step: the tracker has turned its box around."""
    lane_reach_m: float = 4.5
    """Lanes further away are not followed: more than a lane's width of 3.7 m."""
    lane_turn_rad: float = 1.05
    """Lanes at a larger angle, 60 degrees, are crossed, not followed."""
    num_candidates: int = 6
    """Lanes at a place, the nearest ones; more overlap only in the middle of junctions."""
    num_hops: int = 3
    """Lanes in turn that count as one way: maps cut lanes into short pieces."""
    apart_m: float = 1.2
    """Lanes that are nearer to one another, such as in a fork, are one place."""
    lane_shift_m: float = 1.8
    """Least shift of a lane change: half the lane's width, as highD counts them."""
    lane_drift_m: float = 0.3
    """Least part of a lane change in each of the lanes."""
    lane_drift_mps: float = 0.25
    """A lane change lasts while the agent goes aside faster than in its lane."""
    lane_change_s: float = 5.0
    """Longest half of a lane change; whole ones take 2 to 8 s (Toledo and Zohar 2007)."""
    lane_change_yaw_rad: float = 0.45
    """Agents that yaw more while they change lanes turn in a junction."""
    turn_rate_rad_s: float = 0.06
    """Yaw rate of turns; at 10 m/s it is a radius of 170 m."""
    turn_pause_s: float = 1.2
    """Turns go on after a pause, such as for pedestrians."""
    turn_way_m: float = 2.0
    """Least way of a turn: no vehicle turns on the spot."""
    turn_rad: float = 0.7
    """Least turn, 40 degrees: junctions are skewed, and tracks end within turns."""
    u_turn_rad: float = 2.6
    """Least turn back, 150 degrees."""
    corner_m: float = 20.0
    """Where no lane tells a turn from a bend, turns have a smaller radius."""
    crossed_m: float = 10.0
    """Way within a junction that crosses it."""
    roundabout_m: float = 60.0
    """Radius of the largest roundabouts; lanes of a larger one count as straight."""
    stand_s: float = 1.0
    """Shorter stops are the noise of tracks."""
    parked_m: float = 1.5
    """Who never leaves a place by more has not moved; tracks of parked cars jitter."""
    off_lane_m: float = PARKED_OFFSET_M
    off_lane_rad: float = PARKED_TURN_RAD
    moved_m: float = 2.0
    """Way before and after a stop that makes it stop and go."""
    braking_s: float = 0.4
    """Shorter decelerations are the noise of tracks."""
    braked_mps: float = 1.0
    """Least loss of speed within 0.6 s, by the places, of who brakes hard."""
    pairs_m: float = 60.0
    """Agents whose ways stay further apart have nothing to do with one another."""
    headway_s: float = 3.0
    """Followers keep less; at more, drivers are free (Vogel 2002: 6 s; HCM: 3 s)."""
    follow_s: float = 2.0
    """Who is behind for a shorter time does not follow."""
    cut_in_s: float = 2.5
    """Headway left to who is cut off; it is under the usual one."""
    crossing_pet_s: float = 5.0
    """Longer times after one another are no interaction (FHWA SSAM: 5 s)."""
    crossing_rad: float = 0.52
    """Paths at a smaller angle, 30 degrees, merge or follow."""
    joined_s: float = 1.5
    """Who goes in one direction so long after they met merge, others cross."""
    new_s: float = 0.6
    """Tracks that are younger may be another's that goes on."""
    near_m: float = 1.0
    """Least gap after a short time to collision: queues and cars beside keep more."""
    near_ttc_s: float = 1.5
    """Conflicts have a shorter time to collision (FHWA SSAM)."""
    near_pet_s: float = 1.0
    """So have those with a shorter time after one another (Allen and others 1978)."""
    slip_rad: float = 0.35
    """No vehicle goes at a larger angle, 20 degrees, to where its box points."""
    tracked_s: float = 1.0
    """Time for which an agent's track is sound before it meets another."""
    near_s: float = 0.6
    """Shorter conflicts are the noise of tracked velocities."""
    near_braking_mps2: float = 3.35
    """Conflicts need harder braking than this to be avoided (Archer 2005)."""
    yield_share: float = 0.5
    """Who yields slows to this share of the speed that it came with, or less."""
    yield_m: float = 25.0
    """Distance from the place of crossing at which who yields is slowest, at most."""
    beside_m: float = 2.0
    """Gap to a cyclist beside; laws ask for 1.5 m."""
    beside_s: float = 0.6
    """Least time of being beside, overtaking or on a crosswalk."""
    passing_m: float = 6.0
    """Overtaken agents are at most this far aside."""


LIMITS: Final = ManoeuvreLimits()


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A road users at S steps; where one is absent, its nearest earlier state."""

    agents: AgentStates
    """Road users at these steps; the states fill gaps, ``is_valid`` has them."""
    speed_mps: Float[np.ndarray, "A S"]
    """Without outliers."""
    time_s: Float[np.ndarray, "S"]
    """Seconds after the current step."""
    step_s: float

    @classmethod
    def of(cls, scenario: Scenario) -> "Motion":
        """Motion of a scenario's road users that are there at two steps or more."""
        axis, tracks = scenario.time_axis, scenario.agents
        stride = max(1, round(LIMITS.sampling_s / axis.step_s))
        steps = np.arange(axis.current_step % stride, axis.num_steps, stride)
        is_valid = tracks.is_valid[:, steps]
        rows = tracks.kind_mask(ROAD_USER_KINDS) & (is_valid.sum(axis=1) > 1)
        rows = np.flatnonzero(rows)
        is_valid = is_valid[rows]
        filled = _nearest_step(is_valid)
        at = rows[:, None], steps[filled]
        states = AgentStates(
            ids=tuple(tracks.ids[row] for row in rows),
            kinds=tuple(tracks.kinds[row] for row in rows),
            size_m=tracks.size_m[rows],
            is_valid=is_valid,
            **{name: getattr(tracks, name)[at] for name in MOTION},
        )
        wide = np.pad(states.speed_mps(), ((0, 0), (2, 2)), mode="edge")
        return cls(
            agents=states,
            speed_mps=np.median(sliding_window_view(wide, 5, axis=1), axis=-1),
            time_s=axis.times_s()[steps],
            step_s=stride * axis.step_s,
        )

    def __len__(self) -> int:
        return len(self.agents)

    @cached_property
    def is_follower(self) -> Bool[np.ndarray, "A"]:
        """Whether each follows lanes."""
        return self.agents.kind_mask(LANE_FOLLOWER_KINDS)

    @cached_property
    def has_moved(self) -> Bool[np.ndarray, "A"]:
        """Whether each leaves its place."""
        place = self.agents.position_m
        middle = (place.max(axis=1) + place.min(axis=1)) / 2
        far = np.linalg.norm(place - middle[:, None], axis=-1).max(axis=1, initial=0.0)
        return far > LIMITS.parked_m

    @cached_property
    def way_m(self) -> Float[np.ndarray, "A S"]:
        """Way up to each step, without what standing agents jitter."""
        step = np.linalg.norm(np.diff(self.agents.position_m, axis=1), axis=-1)
        step = np.where(self.speed_mps[:, 1:] >= STANDING_MPS, step, 0.0)
        return np.pad(step.cumsum(axis=1), ((0, 0), (1, 0)))

    @cached_property
    def yaw_rad(self) -> Float[np.ndarray, "A S"]:
        """Turn since the step before, without boxes that the tracker turned around."""
        turn = wrap_angle(np.diff(self.agents.heading_rad, axis=1))
        turn = np.where(np.abs(turn) < LIMITS.jump_rad, turn, 0.0)
        return np.pad(turn, ((0, 0), (1, 0)))

    @cached_property
    def forward(self) -> Float[np.ndarray, "A S 2"]:
        """Unit vectors along the headings."""
        return unit_vector(self.agents.heading_rad)

    @cached_property
    def velocity_mps(self) -> Float[np.ndarray, "A S 2"]:
        """Velocity of the way; that of tracks comes some tenths of a second late.

        Who never leaves its place has none: its track jitters.
        """
        velocity = np.gradient(self.agents.position_m, self.step_s, axis=1)
        return np.where(self.has_moved[:, None, None], velocity, 0.0)

    @cached_property
    def _is_sound(self) -> Bool[np.ndarray, "A S"]:
        """Whether one is there, and its box points along its way; others are noise."""
        along = np.einsum("asd,asd->as", self.velocity_mps, self.forward)
        speed = np.linalg.norm(self.velocity_mps, axis=-1)
        points = (along > np.cos(LIMITS.slip_rad) * speed) | (speed < 2 * MOVING_MPS)
        return points & self.agents.is_valid

    def is_tracked(
        self, row: Int[np.ndarray, "*N"], step: Int[np.ndarray, "*N"]
    ) -> Bool[np.ndarray, "*N"]:
        """Whether agents have been there for some time, and move as their boxes say."""
        before = step[..., None] - np.arange(round(LIMITS.tracked_s / self.step_s))
        return np.all(self._is_sound[row[..., None], np.maximum(before, 0)], axis=-1)

    def runs(
        self, holds: Bool[np.ndarray, "R S"], least_s: float, pause_s: float = 0.0
    ) -> Int[np.ndarray, "N 3"]:
        """Rows, first and last steps of times for which something holds.

        Shorter pauses are filled, then shorter times left out.
        """
        if pause_s:
            gaps = _runs(~holds)
            inner = (gaps[:, 1] > 0) & (gaps[:, 2] < holds.shape[1] - 1)
            short = (gaps[:, 2] - gaps[:, 1] + 1) * self.step_s <= pause_s
            holds = holds.copy()
            for row, first, last in gaps[inner & short].tolist():
                holds[row, first : last + 1] = True
        found = _runs(holds)
        lasts = (found[:, 2] - found[:, 1] + 1) * self.step_s
        return found[lasts >= least_s - 1e-9]


def _runs(holds: Bool[np.ndarray, "R S"]) -> Int[np.ndarray, "N 3"]:
    edges = np.diff(holds.astype(np.int8), axis=1, prepend=0, append=0)
    row, first = np.nonzero(edges == 1)
    return np.stack([row, first, np.nonzero(edges == -1)[1] - 1], axis=1)


def _nearest_step(is_valid: Bool[np.ndarray, "A S"]) -> Int[np.ndarray, "A S"]:
    """The last step up to each at which an agent is there; before its first, that one."""
    steps = np.where(is_valid, np.arange(is_valid.shape[1]), -1)
    last = np.maximum.accumulate(steps, axis=1)
    return np.where(last < 0, is_valid.argmax(axis=1)[:, None], last)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneTracks:
    """Lanes of A agents at S steps."""

    lane: Int[np.ndarray, "A S"]
    """Row in the lane graph; -1 where none is followed."""
    offset_m: Float[np.ndarray, "A S"]
    """Offset to the left of the lane."""
    turn_rad: Float[np.ndarray, "A S"]
    """Heading minus the lane's direction."""
    leads_to: Bool[np.ndarray, "N N"]
    """Whether a lane is another one or leads to it; the last row and column are no lane."""
    is_junction: Bool[np.ndarray, "A S"]
    """Whether the lane is one of a junction."""
    knows_junctions: bool
    """Whether the map tells lanes of junctions from others."""


def lane_tracks(road_map: RoadMap, motion: Motion) -> LaneTracks:
    """Follow lanes by place and heading; a successor is the same way, a change costs.

    So noise, short segments, forks and lanes that cross do not change lanes.
    """
    graph, agents = lane_graph(road_map), motion.agents
    shape, count = agents.is_valid.shape, len(graph.lane_ids)
    lane = np.full((*shape, LIMITS.num_candidates + 1), -1)
    offset, turn = np.zeros(lane.shape), np.zeros(lane.shape)
    cost = np.full(lane.shape, np.inf)
    cost[..., -1] = 9.0
    # Of who stays in its place the first step is enough.
    wanted = agents.is_valid & motion.is_follower[:, None]
    first = np.arange(shape[1]) == agents.is_valid.argmax(axis=1)[:, None]
    row, step = np.nonzero(wanted & (motion.has_moved[:, None] | first))
    if count and len(row):
        usable = usable_lanes(graph, agents.kinds)[row]
        place, heading = agents.position_m[row, step], agents.heading_rad[row, step]
        near = graph.search.in_reach(place, heading, usable, LIMITS.lane_reach_m)
        keep = np.abs(near.turn_rad) <= LIMITS.lane_turn_rad
        point = near.point[keep]
        rank = np.arange(len(point)) - np.searchsorted(point, point)
        good = rank < LIMITS.num_candidates
        at = row[point[good]], step[point[good]], rank[good]
        lane[at] = near.lane[keep][good]
        offset[at] = near.offset_m[keep][good]
        turn[at] = near.turn_rad[keep][good]
        # Past an end of a lane the distance counts, so that the next one is taken.
        far = near.distance_m[keep][good]
        cost[at] = np.minimum((far / 1.2) ** 2, 8.0) + (turn[at] / 0.5) ** 2
    leads_to = _leads_to(graph)
    pick = _likeliest(lane, offset, 0.2 * cost, leads_to)[..., None]
    chosen = np.take_along_axis(lane, pick, axis=-1)[..., 0]
    crossing = np.array(
        [road_map.lane_of[one].is_intersection for one in graph.lane_ids], bool
    )
    return LaneTracks(
        lane=chosen,
        offset_m=np.take_along_axis(offset, pick, axis=-1)[..., 0],
        turn_rad=np.take_along_axis(turn, pick, axis=-1)[..., 0],
        leads_to=leads_to,
        is_junction=np.append(crossing, False)[chosen],
        knows_junctions=bool(crossing.any()),
    )


def _leads_to(graph: LaneGraph) -> Bool[np.ndarray, "N N"]:
    count = len(graph.lane_ids)
    reach = np.eye(count + 1, dtype=bool)
    reach[-1, -1] = False
    for start in range(count):
        edge = {start}
        for _ in range(LIMITS.num_hops):
            edge = {after for one in edge for after in graph.successors[one]}
            reach[start, list(edge)] = True
    return reach


def _likeliest(
    lane: Int[np.ndarray, "A S K"],
    offset_m: Float[np.ndarray, "A S K"],
    cost: Float[np.ndarray, "A S K"],
    leads_to: Bool[np.ndarray, "N N"],
) -> Int[np.ndarray, "A S"]:
    """Candidates of the cheapest sequence (Viterbi's algorithm), for all agents at once."""
    num_steps = lane.shape[1]
    one, two = lane[:, :-1, :, None], lane[:, 1:, None]
    # Steps back are the noise of who hardly moves.
    change = np.where(leads_to[one, two], 0.0, np.where(leads_to[two, one], 0.3, 3.0))
    apart = np.abs(offset_m[:, :-1, :, None] - offset_m[:, 1:, None])
    change = np.where(apart < LIMITS.apart_m, np.minimum(change, 0.7), change)
    change = np.where((one < 0) | (two < 0), 1.0, change)
    change = np.where((one < 0) & (two < 0), 0.0, change)
    total, back = cost[:, 0], []
    for step in range(1, num_steps):
        every = total[:, :, None] + change[:, step - 1]
        back.append(every.argmin(axis=1))
        total = every.min(axis=1) + cost[:, step]
    pick = np.zeros(lane.shape[:2], int)
    pick[:, -1] = total.argmin(axis=1)
    for step in range(num_steps - 1, 0, -1):
        at = pick[:, step, None]
        pick[:, step - 1] = np.take_along_axis(back[step - 1], at, axis=1)[:, 0]
    return pick
