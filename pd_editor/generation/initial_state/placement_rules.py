"""Rules for placed agents: each finds those that conflict with others, the road or a path."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.guidance.guidance_kind import LIMIT_BRAKING_MPS2
from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.analysis.metrics.lanes import usable_lanes
from pd_editor.analysis.metrics.road import ASKEW_TO_LANE_DEG, is_off_road, nearest_lane
from pd_editor.analysis.repair.state_repairs import STANDING_GAP_M, gaps_ahead_m
from pd_editor.generation.core.config_limits import check_settings
from pd_editor.generation.initial_state.kept_paths import KeptPaths
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, PARKED_OFFSET_M

_ACROSS_SINE: Final = 0.5
"""Courses that differ by more than 30 degrees, and less than 150, cross."""


@dataclass(frozen=True, kw_only=True)
class ConflictResampling:
    """How agents that conflict with a neighbour, road or kept path are sampled again.

    Agents that are denoised together each see the noisy states of the others, so some
    end in bunches, fast behind an agent that stands, or on courses that cross. Sampled
    again, given all others, they see clean states.
    """

    num_versions: int = 2
    """Number of versions of these agents that are sampled, in one batch; twice as many for
    quality "high". Each agent gets its state of one of them. All versions together take as
    many denoising steps as the sampler."""
    queue_gap_m: float = 12.0
    """An agent that stands conflicts with a moving one that is less than this ahead."""
    queue_leader_mps: float = 3.0
    """Speed of that moving agent, at least."""
    crossing_s: float = 3.0
    """Moving agents on crossing courses conflict if they meet within this time at constant
    velocity."""
    crossing_m: float = 3.0
    """Distance of their centres at which they meet."""
    beside_road_m: float = 9.0
    """A vehicle that stands off the drivable area conflicts with the road if it is nearer
    than this to a lane and askew to it."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedTraffic:
    """A agents on a road, at its current step, and the paths that others keep."""

    agents: AgentTracks
    scenario: Scenario
    """Its road and its current step count, not its agents."""
    kept: KeptPaths
    settings: ConflictResampling
    gap_m: float
    """Boxes nearer than this to each other conflict."""

    @cached_property
    def position_m(self) -> Float[np.ndarray, "A 2"]:
        """Centres."""
        return self.agents.position_m[:, self.scenario.current_step]

    @cached_property
    def heading_rad(self) -> Float[np.ndarray, "A"]:
        """Headings."""
        return self.agents.heading_rad[:, self.scenario.current_step]

    @cached_property
    def velocity_mps(self) -> Float[np.ndarray, "A 2"]:
        """Velocities."""
        return self.agents.velocity_mps[:, self.scenario.current_step]

    @cached_property
    def speed_mps(self) -> Float[np.ndarray, "A"]:
        """Speeds."""
        return np.hypot(*self.velocity_mps.T)

    @cached_property
    def offset_m(self) -> Float[np.ndarray, "A A 2"]:
        """From each agent to each other one."""
        return self.position_m[None] - self.position_m[:, None]

    @cached_property
    def crosses(self) -> Bool[np.ndarray, "A A"]:
        """Which courses cross."""
        return np.abs(np.sin(self._turn)) >= _ACROSS_SINE

    @cached_property
    def gap_ahead_m(self) -> Float[np.ndarray, "A A"]:
        """Gap to each agent ahead; one that crosses has left before another arrives."""
        gaps = gaps_ahead_m(self.agents, self.scenario.current_step)
        return np.where(self.crosses, np.inf, gaps)

    @cached_property
    def leader_mps(self) -> Float[np.ndarray, "A A"]:
        """Speed of each other agent along the course of one; 0 if it comes the other way."""
        return np.where(np.cos(self._turn) > 0, self.speed_mps[None], 0.0)

    @cached_property
    def _turn(self) -> Float[np.ndarray, "A A"]:
        return self.heading_rad[None] - self.heading_rad[:, None]


Offenders = Callable[[PlacedTraffic], Bool[np.ndarray, "A A"]]


@dataclass(frozen=True)
class PlacementRule:
    """A rule that placed agents keep, or are sampled again."""

    name: str
    offenders: Offenders
    """Pairs that break it, in either order; on the diagonal those that break it alone."""


def _near(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which boxes are too near to each other."""
    boxes = Boxes(
        position_m=traffic.position_m,
        heading_rad=traffic.heading_rad,
        size_m=traffic.agents.size_m + traffic.gap_m,
    )
    offset = traffic.offset_m
    reach = boxes.radius_m[None] + boxes.radius_m[:, None]
    found = np.triu(np.hypot(offset[..., 0], offset[..., 1]) < reach, 1)
    first, second = np.nonzero(found)
    found[first, second] = boxes_touch(boxes[first], boxes[second])
    return found


def _brakes(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which agents can follow others only by braking harder than down to a limit."""
    speed = traffic.speed_mps[:, None]
    free_m = np.maximum(traffic.gap_ahead_m - STANDING_GAP_M, 0.0)
    needed = speed**2 - traffic.leader_mps**2
    return (speed >= MOVING_MPS) & (needed > 2 * LIMIT_BRAKING_MPS2 * free_m)


def _waits(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which agents stand closely behind one that moves."""
    waits = traffic.speed_mps[:, None] < MOVING_MPS
    waits = waits & (traffic.leader_mps > traffic.settings.queue_leader_mps)
    return waits & (traffic.gap_ahead_m < traffic.settings.queue_gap_m)


def _crossing(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which agents are on crossing courses and meet soon."""
    offset, velocity = traffic.offset_m, traffic.velocity_mps
    moves = traffic.speed_mps >= MOVING_MPS
    drift = velocity[None] - velocity[:, None]
    squared = np.maximum((drift**2).sum(axis=-1), 1e-9)
    nearest_s = np.clip(
        -(offset * drift).sum(axis=-1) / squared, 0.0, traffic.settings.crossing_s
    )
    apart = np.linalg.norm(offset + drift * nearest_s[..., None], axis=-1)
    found = traffic.crosses & moves & moves[:, None]
    return found & (apart < traffic.settings.crossing_m)


def _wrong_way(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which agents are in a lane that leads the other way; parked ones are not in it."""
    agents, step = traffic.agents, traffic.scenario.current_step
    graph = lane_graph(traffic.scenario.road_map)
    in_lane, along_lane = graph.extended_search.is_near_paths(
        agents.position_m[:, step, None],
        agents.heading_rad[:, step, None],
        agents.is_valid[:, step, None],
        usable_lanes(graph, agents.kinds),
        PARKED_OFFSET_M,
    )
    return np.diag((in_lane & ~along_lane)[:, 0])


def _askew_off_road(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which vehicles stand beside a road, off the drivable area, and askew to it."""
    scenario, agents = traffic.scenario, traffic.agents
    found = traffic.speed_mps < MOVING_MPS
    found &= agents.is_valid[:, scenario.current_step]
    found &= agents.kind_mask({AgentKind.VEHICLE})
    position = traffic.position_m
    found[found] = is_off_road(scenario, position[found])
    low, high = ASKEW_TO_LANE_DEG
    lane_m, turn = nearest_lane(
        scenario.road_map, position[found], traffic.heading_rad[found]
    )
    found[found] = (
        (lane_m < traffic.settings.beside_road_m) & (low < turn) & (turn < high)
    )
    return np.diag(found)


def _in_the_way(traffic: PlacedTraffic) -> Bool[np.ndarray, "A A"]:
    """Which agents are where one with a kept trajectory will be."""
    blocked = traffic.kept.blocked_by(
        traffic.agents,
        traffic.scenario.current_step,
        ahead_s=traffic.settings.crossing_s,
        gap_m=traffic.gap_m,
    )
    return np.diag(blocked)


PLACEMENT_RULES: Final = (
    PlacementRule("near", _near),
    PlacementRule("brakes", _brakes),
    PlacementRule("waits", _waits),
    PlacementRule("crossing", _crossing),
    PlacementRule("wrong way", _wrong_way),
    PlacementRule("askew off road", _askew_off_road),
    PlacementRule("in the way", _in_the_way),
)
"""All rules; any selection of them works, and their order does not matter."""
