"""Nearest segments of centre lines for the paths of many agents at once."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.metrics.map_points import boxes_near
from pd_editor.paths.lane_graph import LaneGraph

DEAD_END_M: Final = 100.0
"""A lane without a successor is thought to go straight on so far."""
_NEAR_M: Final = 6.0
"""Lanes are first looked for so far from an agent's way, then everywhere."""
_CHUNK: Final = 200_000


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSearch:
    """Searches among the S segments of a map's lanes, dead ends made longer."""

    graph: LaneGraph

    @cached_property
    def length_m(self) -> Float[np.ndarray, "S"]:
        """Length of each segment; the last one of a dead end goes on."""
        segments = self.graph.segments
        length = segments.length_m.copy()
        if not len(length):
            return length
        last = np.append(segments.first_of_lane[1:], len(length)) - 1
        is_dead_end = np.array([not after for after in self.graph.successors], bool)
        length[last[is_dead_end]] += DEAD_END_M
        return length

    @cached_property
    def bounds_m(self) -> tuple[Float[np.ndarray, "S 2"], Float[np.ndarray, "S 2"]]:
        """Least and greatest coordinates of each segment."""
        segments = self.graph.segments
        start = segments.start_m
        end = start + self.length_m[:, None] * segments.direction
        return np.minimum(start, end), np.maximum(start, end)

    def nearest(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        is_valid: Bool[np.ndarray, "A H"],
        lanes: Bool[np.ndarray, "A L"],
    ) -> tuple[Float[np.ndarray, "A H"], Int[np.ndarray, "A H"]]:
        """Distance to, and index of, the nearest segment of each agent's lanes.

        Each agent with a valid step must have a lane.
        """
        squared = np.full(is_valid.shape, np.inf)
        found = np.zeros(is_valid.shape, int)
        agent, segment = self._pairs(position_m, is_valid, lanes, _NEAR_M)
        if len(agent):
            near = self._squared_m2(position_m[agent], segment[:, None])
            first = np.flatnonzero(np.diff(agent, prepend=-1))
            least = np.minimum.reduceat(near, first, axis=0)
            owner = agent[first]
            squared[owner] = least
            number = np.append(first[1:], len(agent)) - first
            pair, step = np.nonzero(near == np.repeat(least, number, axis=0))
            found[agent[pair], step] = segment[pair]
        row, step = np.nonzero(is_valid & ~(squared <= _NEAR_M**2))
        self._search_everywhere(position_m, lanes, row, step, squared, found)
        return np.where(is_valid, np.sqrt(np.where(is_valid, squared, 0)), 0), found

    def lanes_below(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        heading_rad: Float[np.ndarray, "A H"],
        is_valid: Bool[np.ndarray, "A H"],
        lanes: Bool[np.ndarray, "A L"],
        reach_m: float,
    ) -> tuple[Bool[np.ndarray, "A H"], Bool[np.ndarray, "A H"]]:
        """Whether a segment is within reach, and one within 90 degrees of the heading."""
        below, along = np.zeros(is_valid.shape, bool), np.zeros(is_valid.shape, bool)
        agent, segment = self._pairs(position_m, is_valid, lanes, reach_m)
        if not len(agent):
            return below, along
        near = self._squared_m2(position_m[agent], segment[:, None]) <= reach_m**2
        ux, uy = self.graph.segments.direction[segment].T[:, :, None]
        x, y = np.cos(heading_rad), np.sin(heading_rad)
        first = np.flatnonzero(np.diff(agent, prepend=-1))
        owner = agent[first]
        below[owner] = np.logical_or.reduceat(near, first, axis=0)
        near &= x[agent] * ux + y[agent] * uy > 0
        along[owner] = np.logical_or.reduceat(near, first, axis=0)
        return below & is_valid, along & is_valid

    def _pairs(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        is_valid: Bool[np.ndarray, "A H"],
        lanes: Bool[np.ndarray, "A L"],
        reach_m: float,
    ) -> tuple[Int[np.ndarray, "Q"], Int[np.ndarray, "Q"]]:
        """Agents and segments of their lanes within reach of all they pass."""
        agent, segment = boxes_near(position_m, is_valid, *self.bounds_m, reach_m)
        mine = lanes[agent, self.graph.segments.lane[segment]]
        return agent[mine], segment[mine]

    def _squared_m2(
        self,
        points_m: Float[np.ndarray, "N H 2"],
        segment: Int[np.ndarray, "..."],
    ) -> Float[np.ndarray, "N K"]:
        """Squared distances of points to segments; the two shapes are broadcast."""
        segments = self.graph.segments
        start, direction = segments.start_m[segment], segments.direction[segment]
        dx = points_m[..., 0] - start[..., 0]
        dy = points_m[..., 1] - start[..., 1]
        along = dx * direction[..., 0]
        along += dy * direction[..., 1]
        np.clip(along, 0.0, self.length_m[segment], out=along)
        dx -= along * direction[..., 0]
        dy -= along * direction[..., 1]
        dx *= dx
        dy *= dy
        dx += dy
        return dx

    def _search_everywhere(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        lanes: Bool[np.ndarray, "A L"],
        row: Int[np.ndarray, "N"],
        step: Int[np.ndarray, "N"],
        squared: Float[np.ndarray, "A H"],
        found: Int[np.ndarray, "A H"],
    ) -> None:
        """Fill in what was not found nearby."""
        segments = self.graph.segments
        if not len(row):
            return
        every = np.arange(len(segments.lane))
        chunk = max(1, _CHUNK // len(every))
        for start in range(0, len(row), chunk):
            some, at = row[start : start + chunk], step[start : start + chunk]
            far = self._squared_m2(position_m[some, at][:, None], every)
            far[~lanes[some][:, segments.lane]] = np.inf
            best = far.argmin(axis=1)
            found[some, at] = best
            squared[some, at] = far[np.arange(len(best)), best]
