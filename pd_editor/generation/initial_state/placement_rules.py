"""Rules for placed agents, and the search for those that break one."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.guidance.guidance_kind import LIMIT_BRAKING_MPS2
from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.analysis.metrics.lanes import usable_lanes
from pd_editor.analysis.metrics.road import ASKEW_TO_LANE_DEG, is_off_road, nearest_lane
from pd_editor.analysis.repair.state_repairs import GAP_M, STANDING_GAP_M, gaps_ahead_m
from pd_editor.generation.defaults import check_settings
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.oriented_box import Boxes, BoxStates
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, PARKED_OFFSET_M


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptPaths:
    """Boxes of K moving agents with kept trajectories, from the current step on."""

    boxes: BoxStates
    time_s: Float[np.ndarray, "S"]
    """Times after the current step."""

    @classmethod
    def of(cls, scenario: Scenario, generated_ids: Collection[str]) -> "KeptPaths":
        """All agents that move later, but those whose trajectories are generated."""
        agents, now = scenario.agents, scenario.current_step
        steps = np.arange(now, agents.num_steps, 2)
        speed = np.hypot(*np.moveaxis(agents.velocity_mps[:, steps], -1, 0))
        moves = (agents.is_valid[:, steps] & (speed >= MOVING_MPS)).any(axis=1)
        generated = agents.rows(tuple(generated_ids))
        late = LateAgents.of(scenario)
        moves[generated] = False
        # What enters later at the place of such an agent may be that agent, tracked again.
        moves[late.continuing(generated).row] = False
        return cls(
            boxes=agents.taken(np.flatnonzero(moves)).at_steps(steps),
            time_s=(steps - now) * scenario.time_axis.step_s,
        )

    def blocked_by(
        self, agents: AgentTracks, step: int, *, ahead_s: float, gap_m: float
    ) -> Bool[np.ndarray, "A"]:
        """Which agents, with their states at a step, are in the way of any of the K.

        One that stands is there all the time; one that moves is followed at constant
        velocity for ``ahead_s``. ``gap_m`` is the least distance of boxes.
        """
        kept, velocity = self.boxes, agents.velocity_mps[:, step]
        moves = np.hypot(*velocity.T) >= MOVING_MPS
        there = ~moves[:, None] | (self.time_s <= ahead_s)
        drift = np.where(moves[:, None], velocity, 0.0)
        place = agents.position_m[:, step, None] + drift[:, None] * self.time_s[:, None]
        boxes = Boxes(
            position_m=place,
            heading_rad=np.broadcast_to(
                agents.heading_rad[:, step, None], place.shape[:2]
            ),
            size_m=agents.size_m[:, None] + 2 * gap_m,
        )
        offset = place[:, None] - kept.position_m
        near = np.hypot(offset[..., 0], offset[..., 1]) < (
            boxes.radius_m[:, None] + kept.radius_m[:, None]
        )
        near &= there[:, None] & kept.is_valid
        agent, other, at = np.nonzero(near)
        touch = boxes_touch(boxes[agent, at], kept.at(other, at))
        return np.isin(np.arange(len(agents)), agent[touch])


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
        # Courses that differ by more than 30 degrees, and less than 150, cross.
        return np.abs(np.sin(self._turn)) >= 0.5

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


@dataclass(frozen=True, kw_only=True)
class ConflictSearch:
    """Search for placed agents that break any of some rules."""

    settings: ConflictResampling
    gap_m: float
    """Boxes nearer than this to each other conflict."""
    rules: Sequence[PlacementRule] = PLACEMENT_RULES

    @classmethod
    def of(
        cls,
        settings: ConflictResampling,
        guidance: InitialStateGuidance,
        rules: Sequence[PlacementRule] = PLACEMENT_RULES,
    ) -> "ConflictSearch":
        """Search with a gap half-way between those of guidance and of repairs."""
        return cls(settings=settings, gap_m=(guidance.gap_m + GAP_M) / 2, rules=rules)

    def conflicting(
        self,
        scenario: Scenario,
        placed_ids: Collection[str],
        random: np.random.Generator,
        kept: KeptPaths,
    ) -> tuple[str, ...]:
        """Placed agents without which no placed agent is in conflict.

        Agents with most conflicts come first; of equal ones any may be chosen.
        """
        agents, step = scenario.agents, scenario.current_step
        rows = np.flatnonzero(
            agents.is_valid[:, step] & agents.kind_mask(LANE_FOLLOWER_KINDS)
        )
        agents = agents.taken(rows)
        placed = frozenset(placed_ids)
        may_go = np.array([name in placed for name in agents.ids], bool)
        remains = self.conflicts(agents, scenario, kept)
        chosen: list[str] = []
        while True:
            number = remains.sum(axis=1) * may_go
            if not number.any():
                return tuple(chosen)
            row = int(random.choice(np.flatnonzero(number == number.max())))
            chosen.append(agents.ids[row])
            remains[row], remains[:, row] = False, False

    def best_of(
        self,
        versions: Sequence[Scenario],
        agent_ids: Collection[str],
        kept: KeptPaths,
    ) -> Scenario:
        """Scenario in which each of some agents has its state of one version.

        Versions differ in the states of these agents only. First comes the version with
        fewest conflicts; an agent in conflict then gets its state of another version if
        that has fewer.
        """
        if len(versions) == 1:
            return versions[0]
        agents, step = versions[0].agents, versions[0].current_step
        own = agents.rows(tuple(agent_ids))
        states = agents
        for number, version in enumerate(versions):
            again = version.agents.taken(version.agents.rows(tuple(agent_ids)))
            names = tuple(f"{number}/{name}" for name in again.ids)
            states = states.joined(replace(again, ids=names))
        found = self.conflicts(states, versions[0], kept)
        counts = states.is_valid[:, step] & states.kind_mask(LANE_FOLLOWER_KINDS)
        found &= counts & counts[:, None]
        # Row of each agent's state in each version; other agents have one state only.
        table = len(agents) + np.arange(len(versions) * len(own)).reshape(-1, len(own))
        rows = np.arange(len(agents))
        totals: list[int] = []
        for candidates in table:
            rows[own] = candidates
            totals.append(int(found[np.ix_(candidates, rows)].sum()))
        rows[own] = table[np.argmin(totals)]
        for row, candidates in zip(own, table.T, strict=True):
            others = np.delete(rows, row)
            number = found[np.ix_(candidates, others)].sum(axis=1)
            number += found[candidates, candidates]
            used = int(np.flatnonzero(candidates == rows[row])[0])
            if number.min() < number[used]:
                rows[row] = candidates[number.argmin()]
        return versions[0].with_agents(replace(states.taken(rows), ids=agents.ids))

    def conflicts(
        self, agents: AgentTracks, scenario: Scenario, kept: KeptPaths
    ) -> Bool[np.ndarray, "A A"]:
        """Which pairs break a rule, and on the diagonal which agents break one alone.

        Symmetric. The agents are on the road of the scenario, at its current step.
        """
        traffic = self.traffic(agents, scenario, kept)
        found = np.zeros((len(agents), len(agents)), bool)
        for rule in self.rules:
            found |= rule.offenders(traffic)
        return found | found.T

    def traffic(
        self, agents: AgentTracks, scenario: Scenario, kept: KeptPaths
    ) -> PlacedTraffic:
        """What rules look at."""
        return PlacedTraffic(
            agents=agents,
            scenario=scenario,
            kept=kept,
            settings=self.settings,
            gap_m=self.gap_m,
        )
