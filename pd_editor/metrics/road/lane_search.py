"""Nearest segments of centre lines for the paths of many agents."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.metrics.road.path_pieces import PathPieces, in_pieces, joined_pieces
from pd_editor.paths.lanes.lane_graph import LaneGraph

DEAD_END_M: Final = 100.0
"""Lanes without a successor are extended straight by this length."""
_SPARE_M: Final = 3.0
"""Reach of the fast search beyond an agent's initial distance to its lanes."""
_CHUNK: Final = 200_000


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSearch:
    """Search among the S segments of a map's lanes with extended dead ends."""

    graph: LaneGraph

    @cached_property
    def length_m(self) -> Float[np.ndarray, "S"]:
        """Length of each segment; the last one of a dead end is extended."""
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
        """Distance to, and index of, the nearest segment among each agent's lanes.

        Each agent with a valid step must have at least one lane.
        """
        num_steps = is_valid.shape[1]
        reach = self._first_distance_m(position_m, is_valid, lanes)
        reach += np.minimum(_excursion_m(position_m, is_valid), _SPARE_M) + 1e-6
        pieces = PathPieces.of(position_m, is_valid)
        squared = np.full(pieces.is_valid.shape, np.inf)
        found = np.zeros(pieces.is_valid.shape, int)
        piece, segment = self._pairs(pieces, lanes, reach)
        if len(piece):
            near = self._squared_m2(pieces.position_m[piece], segment[:, None])
            first = np.flatnonzero(np.diff(piece, prepend=-1))
            least = np.minimum.reduceat(near, first, axis=0)
            squared[piece[first]] = least
            number = np.append(first[1:], len(piece)) - first
            pair, step = np.nonzero(near == np.repeat(least, number, axis=0))
            found[piece[pair], step] = segment[pair]
        squared = joined_pieces(squared, num_steps)
        found = joined_pieces(found, num_steps)
        row, step = np.nonzero(is_valid & ~(squared <= reach[:, None] ** 2))
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
        """Whether any segment, and any within 90 degrees of the heading, is in reach."""
        num_steps = is_valid.shape[1]
        pieces = PathPieces.of(position_m, is_valid)
        below = np.zeros(pieces.is_valid.shape, bool)
        along = np.zeros(pieces.is_valid.shape, bool)
        piece, segment = self._pairs(pieces, lanes, np.full(len(lanes), reach_m))
        if len(piece):
            near = self._squared_m2(pieces.position_m[piece], segment[:, None])
            near = near <= reach_m**2
            first = np.flatnonzero(np.diff(piece, prepend=-1))
            owner = piece[first]
            below[owner] = np.logical_or.reduceat(near, first, axis=0)
            ux, uy = self.graph.segments.direction[segment].T[:, :, None]
            heading = in_pieces(heading_rad).reshape(pieces.is_valid.shape)
            x, y = np.cos(heading), np.sin(heading)
            near &= x[piece] * ux + y[piece] * uy > 0
            along[owner] = np.logical_or.reduceat(near, first, axis=0)
        below &= pieces.is_valid
        along &= pieces.is_valid
        return joined_pieces(below, num_steps), joined_pieces(along, num_steps)

    def _first_distance_m(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        is_valid: Bool[np.ndarray, "A H"],
        lanes: Bool[np.ndarray, "A L"],
    ) -> Float[np.ndarray, "A"]:
        """Distance to the nearest lane at the first valid step; 0 without any."""
        segments = self.graph.segments
        result = np.zeros(len(position_m))
        row = np.flatnonzero(is_valid.any(axis=1))
        if len(row):
            first = position_m[row, is_valid[row].argmax(axis=1)]
            squared = self._squared_m2(first[:, None], np.arange(len(segments.lane)))
            squared[~lanes[row][:, segments.lane]] = np.inf
            result[row] = np.sqrt(squared.min(axis=1))
        return result

    def _pairs(
        self,
        pieces: PathPieces,
        lanes: Bool[np.ndarray, "A L"],
        reach_m: Float[np.ndarray, "A"],
    ) -> tuple[Int[np.ndarray, "Q"], Int[np.ndarray, "Q"]]:
        """Pairs of a path piece and a segment of its agent's lanes within reach."""
        piece, segment = pieces.near_boxes(*self.bounds_m, reach_m)
        agent = piece // pieces.num_pieces
        mine = lanes[agent, self.graph.segments.lane[segment]]
        return piece[mine], segment[mine]

    def _squared_m2(
        self,
        points_m: Float[np.ndarray, "N H 2"],
        segment: Int[np.ndarray, "..."],
    ) -> Float[np.ndarray, "N K"]:
        """Squared distances of points to segments; the two shapes are broadcast."""
        return self.graph.segments.squared_m2(points_m, segment, self.length_m)

    def _search_everywhere(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        lanes: Bool[np.ndarray, "A L"],
        row: Int[np.ndarray, "N"],
        step: Int[np.ndarray, "N"],
        squared: Float[np.ndarray, "A H"],
        found: Int[np.ndarray, "A H"],
    ) -> None:
        """Fill in the distances that the fast search did not find."""
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


def _excursion_m(
    position_m: Float[np.ndarray, "A H 2"], is_valid: Bool[np.ndarray, "A H"]
) -> Float[np.ndarray, "A"]:
    """Largest distance of each agent from its first valid position."""
    first = is_valid.argmax(axis=1)[:, None, None]
    offset = position_m - np.take_along_axis(position_m, first, axis=1)
    return np.where(is_valid, np.hypot(offset[..., 0], offset[..., 1]), 0.0).max(
        axis=1, initial=0.0
    )
