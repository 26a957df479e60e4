"""Mutable current states of all agents during a repair."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.collisions.box_tests import boxes_collide
from pd_editor.analysis.metrics.road.off_road import is_off_road
from pd_editor.scene.geometry.angles import left_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import lane_kinds_of
from pd_editor.scene.scenario import Scenario

_CHUNK_ENDS: Final = (24, 72)
"""Poses are tested in chunks, since one of the first is usually free."""
_TOLERANCE_M: Final = 1e-6


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
        for end in (*_CHUNK_ENDS, len(position_m)):
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
        return (off_lane[1:] <= off_lane[0] + _TOLERANCE_M) & (
            off_road[0] | ~off_road[1:]
        )

    def carried(self) -> Scenario:
        """Scenario with whole tracks moved rigidly to the new poses."""
        scenario = self.scenario
        agents, step = scenario.agents, scenario.current_step
        before, heading = agents.position_m[:, step], agents.heading_rad[:, step]
        turn = wrap_angle(self.heading_rad - heading)
        moved = (self.position_m != before).any(axis=1) | (turn != 0)
        rows = np.flatnonzero(moved & self.exists)
        if len(rows) == 0:
            return scenario
        is_valid = agents.is_valid[rows]
        target, turn = self.position_m[rows], turn[rows, None]

        def turned(vectors: Float[np.ndarray, "G T 2"]) -> Float[np.ndarray, "G T 2"]:
            x_axis = unit_vector(turn)
            return vectors[..., :1] * x_axis + vectors[..., 1:] * left_of(x_axis)

        offset = agents.position_m[rows] - before[rows, None]
        mask = is_valid[..., None]
        new_heading = wrap_angle(agents.heading_rad[rows] + turn)
        new_heading[:, step] = self.heading_rad[rows]
        position = target[:, None] + turned(offset)
        velocity = turned(agents.velocity_mps[rows])
        return scenario.with_agents(
            agents.with_rows(
                rows,
                position_m=np.where(mask, position, 0.0),
                heading_rad=np.where(is_valid, new_heading, 0.0),
                velocity_mps=np.where(mask, velocity, 0.0),
            )
        )
