"""Which placed agents conflict with a neighbour, the road or a kept trajectory."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool

from pd_editor.analysis.metrics.collisions.box_tests import boxes_touch
from pd_editor.analysis.metrics.road.off_road import is_off_road
from pd_editor.analysis.metrics.road.reachable_lanes import usable_lanes
from pd_editor.analysis.metrics.road.surroundings import ASKEW_TO_LANE_DEG, nearest_lane
from pd_editor.analysis.repair.braking_speeds import STANDING_GAP_M, gaps_ahead_m
from pd_editor.generation.core.config_limits import check_settings
from pd_editor.generation.initial_state.kept_paths import KeptPaths
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

_ACROSS_SINE: Final = 0.5
"""Courses that differ by more than 30 degrees, and less than 150, cross."""
_WIDE_KINDS: Final = frozenset({AgentKind.VEHICLE, AgentKind.BUS})
"""Kinds that fill a lane; cyclists and motorcyclists ride beside others."""


@dataclass(frozen=True, kw_only=True)
class ConflictResampling:
    """How agents that conflict with a neighbour, road or kept path are sampled again.

    Agents that are denoised together each see the noisy states of the others, so some
    end in bunches, fast behind an agent that stands, or on courses that cross. Sampled
    again, given all others, they see clean states. The defaults were chosen on ``train``.
    """

    num_rounds: int = 1
    """Number of times that agents in conflict are sampled again, at most."""
    num_steps: int = 4
    """Denoising steps of a round, at most as many as the sampler has."""
    num_versions: int = 2
    """Number of versions of these agents that a round samples, in one batch. Each agent
    gets its state of one of them: see ``best_of``."""
    num_high_quality_versions: int = 4
    """The same for quality "high"."""
    gap_m: float = 0.45
    """Vehicles and cyclists nearer than this to each other conflict. Guidance pushes boxes
    0.4 m apart, and a repair 0.5: rounding must not decide which agents conflict."""
    braking_mps2: float = 2.0
    """An agent conflicts with one ahead that it can only follow by braking harder."""
    queue_gap_m: float = 12.0
    """An agent that stands conflicts with a moving one that is less than this ahead: of
    recorded ones (``train``) 2 % stand so, of sampled ones 9 %."""
    queue_leader_mps: float = 3.0
    """Speed of that moving agent, at least."""
    side_gap_m: float = 0.7
    """Vehicles side by side with a smaller gap conflict: of recorded ones (``train``) 2.7 %
    stand or drive so, of sampled ones 4 %."""
    crossing_s: float = 3.0
    """Moving agents on crossing courses conflict if they meet within this time at constant
    velocity: of 739 recorded vehicles (``train``) none does, of sampled ones 1.5 %."""
    crossing_m: float = 3.0
    """Distance of their centres at which they meet."""
    wrong_way_m: float = 1.2
    """Agents conflict with the road so near to the centre line of a lane, if each such
    lane leads the other way. Where vehicles park on the left, they stand further off."""
    beside_road_m: float = 9.0
    """A vehicle that stands off the drivable area conflicts with the road if it is nearer
    than this to a lane and askew to it: of the recorded ones that stand (``train``) 0.7 %,
    of sampled ones 3.5 %."""

    def __post_init__(self) -> None:
        check_settings(self)

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
        """Which pairs conflict, and on the diagonal which agents do with road or paths.

        The agents are on the road of the scenario, at its current step.
        """
        step = scenario.current_step
        of_road = self.wrong_way(agents, scenario.road_map, step)
        of_road |= self.askew_off_road(agents, scenario)
        in_the_way = kept.blocked_by(
            agents, step, ahead_s=self.crossing_s, gap_m=self.gap_m
        )
        return self.pairs(agents, step) | np.diag(of_road | in_the_way)

    def wrong_way(
        self, agents: AgentTracks, road_map: RoadMap, step: int
    ) -> Bool[np.ndarray, "A"]:
        """Which agents are in a lane that leads the other way."""
        graph = lane_graph(road_map)
        in_lane, along_lane = graph.extended_search.is_near_paths(
            agents.position_m[:, step, None],
            agents.heading_rad[:, step, None],
            agents.is_valid[:, step, None],
            usable_lanes(graph, agents.kinds),
            self.wrong_way_m,
        )
        return (in_lane & ~along_lane)[:, 0]

    def askew_off_road(
        self, agents: AgentTracks, scenario: Scenario
    ) -> Bool[np.ndarray, "A"]:
        """Which vehicles stand beside a road, off the drivable area, and askew to it."""
        step = scenario.current_step
        position, heading = agents.position_m[:, step], agents.heading_rad[:, step]
        found = np.hypot(*agents.velocity_mps[:, step].T) < MOVING_MPS
        found &= agents.is_valid[:, step] & agents.kind_mask({AgentKind.VEHICLE})
        found[found] = is_off_road(scenario, position[found])
        low, high = ASKEW_TO_LANE_DEG
        lane_m, turn = nearest_lane(scenario.road_map, position[found], heading[found])
        found[found] = (lane_m < self.beside_road_m) & (low < turn) & (turn < high)
        return found

    def pairs(self, agents: AgentTracks, step: int) -> Bool[np.ndarray, "A A"]:
        """Which pairs of agents conflict at a step; symmetric."""
        heading = agents.heading_rad[:, step]
        speed = np.hypot(*agents.velocity_mps[:, step].T)
        turn = heading[None] - heading[:, None]
        # Agents that cross ahead have left before one arrives.
        crosses = np.abs(np.sin(turn)) >= _ACROSS_SINE
        gap = np.where(crosses, np.inf, gaps_ahead_m(agents, step))
        leader = np.where(np.cos(turn) > 0, speed[None], 0.0)
        free_m = np.maximum(gap - STANDING_GAP_M, 0.0)
        brakes = speed[:, None] ** 2 - leader**2 > 2 * self.braking_mps2 * free_m
        waits = (speed[:, None] < MOVING_MPS) & (leader > self.queue_leader_mps)
        found = brakes & (speed[:, None] >= MOVING_MPS)
        found |= waits & (gap < self.queue_gap_m)
        found |= self._near(agents, step) | (~crosses & self._beside(agents, step))
        return found | found.T | self.crossing(agents, step)

    def crossing(self, agents: AgentTracks, step: int) -> Bool[np.ndarray, "A A"]:
        """Which agents are on crossing courses and meet soon; symmetric."""
        position, velocity = agents.position_m[:, step], agents.velocity_mps[:, step]
        heading = agents.heading_rad[:, step]
        crosses = np.abs(np.sin(heading[None] - heading[:, None])) >= _ACROSS_SINE
        moves = np.hypot(*velocity.T) >= MOVING_MPS
        offset = position[None] - position[:, None]
        drift = velocity[None] - velocity[:, None]
        squared = np.maximum((drift**2).sum(axis=-1), 1e-9)
        nearest_s = np.clip(
            -(offset * drift).sum(axis=-1) / squared, 0.0, self.crossing_s
        )
        apart = np.linalg.norm(offset + drift * nearest_s[..., None], axis=-1)
        return crosses & moves & moves[:, None] & (apart < self.crossing_m)

    def _beside(self, agents: AgentTracks, step: int) -> Bool[np.ndarray, "A A"]:
        """Which vehicles are side by side with too small a gap."""
        position = agents.position_m[:, step]
        ahead = unit_vector(agents.heading_rad[:, step])
        offset = position[None] - position[:, None]
        along = np.abs((offset * ahead[:, None]).sum(axis=-1))
        aside = np.abs((offset * left_of(ahead)[:, None]).sum(axis=-1))
        length, width = ((agents.size_m[None] + agents.size_m[:, None]) / 2).T
        is_wide = agents.kind_mask(_WIDE_KINDS)
        found = (along < length) & (aside < width + self.side_gap_m)
        found &= is_wide & is_wide[:, None]
        np.fill_diagonal(found, False)
        return found

    def _near(self, agents: AgentTracks, step: int) -> Bool[np.ndarray, "A A"]:
        boxes = Boxes(
            position_m=agents.position_m[:, step],
            heading_rad=agents.heading_rad[:, step],
            size_m=agents.size_m + self.gap_m,
        )
        offset = boxes.position_m[None] - boxes.position_m[:, None]
        reach = boxes.radius_m[None] + boxes.radius_m[:, None]
        found = np.triu(np.hypot(offset[..., 0], offset[..., 1]) < reach, 1)
        first, second = np.nonzero(found)
        found[first, second] = boxes_touch(boxes[first], boxes[second])
        return found
