"""Routes: chains of lanes along successors, each as one polyline."""

from dataclasses import dataclass, field
from functools import cached_property
from heapq import heappop, heappush
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.polyline import arc_length, without_repeats
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.road_map import LaneKind, RoadMap, once_per_map

MAX_ROUTES_PER_LANE: Final = 12
"""Limit of routes per start lane; beyond it, only the straightest branch is followed."""
SAMPLE_SPACING_M: Final = 1.0
"""Spacing of a route's samples."""
SAMPLED_BEHIND_M: Final = 10.0
"""Length by which a route is extended backwards, straight, from its first lane."""
_TANGENT_M: Final = 3.0
"""Length of the end of a line that defines its final direction."""
_LENGTH_STEP_M: Final = 50.0
"""Requested lengths are rounded up to multiples of this, so that routes are reused."""
_MAX_LANES: Final = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class Route:
    """A chain of lanes as one line.

    Arc length counts from the start of the first lane. Before that, and beyond
    ``extends_m``, the route is extended straight.
    """

    lane_ids: tuple[int, ...]
    """Lanes in driving order; a loop repeats them."""
    lane_ends_m: tuple[float, ...]
    """Arc length at which each lane ends."""
    points_m: Float[np.ndarray, "N 2"]
    """Centre lines joined, without repeated points."""
    is_dead_end: bool
    """Whether the map has no lane behind the last one."""

    @property
    def extends_m(self) -> float:
        """Arc length up to which there are lanes."""
        return self.lane_ends_m[-1]

    @cached_property
    def samples_m(self) -> Float[np.ndarray, "M 2"]:
        """Points every ``SAMPLE_SPACING_M`` from ``-SAMPLED_BEHIND_M`` on.

        The last points are past the lanes; the line through them continues the route.
        """
        points, along = self.points_m, arc_length(self.points_m)
        first = _direction(points[0], points, along, _TANGENT_M)
        last = -_direction(points[-1], points, along, along[-1] - _TANGENT_M)
        behind, ahead = SAMPLED_BEHIND_M, 3 * SAMPLE_SPACING_M
        line = np.concatenate(
            [[points[0] - behind * first], points, [points[-1] + ahead * last]]
        )
        at = np.concatenate([[-behind], along, [along[-1] + ahead]])
        grid = np.arange(-behind, at[-1], SAMPLE_SPACING_M)
        return np.stack([np.interp(grid, at, line[:, axis]) for axis in (0, 1)], -1)

    def num_lanes_within(self, distance_m: float) -> int:
        """Number of lanes that begin before an arc length."""
        for count, end in enumerate(self.lane_ends_m, start=1):
            if end >= distance_m:
                return count
        return len(self.lane_ends_m)


def _direction(
    origin_m: np.ndarray, points_m: np.ndarray, along_m: np.ndarray, distance_m: float
) -> np.ndarray:
    """Unit vector from a point towards the line's point at a distance."""
    there = [np.interp(distance_m, along_m, points_m[:, axis]) for axis in (0, 1)]
    step = np.array(there) - origin_m
    return step / max(float(np.hypot(*step)), 1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneRoutes:
    """Routes of a map, computed on demand and cached."""

    graph: LaneGraph
    _found: dict[tuple[int, float, tuple[LaneKind, ...]], tuple[Route, ...]] = field(
        default_factory=dict
    )

    def from_lane(
        self, lane_id: int, length_m: float, kinds: tuple[LaneKind, ...]
    ) -> tuple[Route, ...]:
        """Routes that begin with a lane and are at least so long, or dead ends.

        Routes differ within ``length_m`` rounded up; the straightest comes first.
        """
        steps = np.ceil(max(length_m, 1.0) / _LENGTH_STEP_M)
        key = (self.graph.row_of[lane_id], float(steps * _LENGTH_STEP_M), kinds)
        if key not in self._found:
            self._found[key] = self._search(*key)
        return self._found[key]

    def _search(
        self, start: int, length_m: float, kinds: tuple[LaneKind, ...]
    ) -> tuple[Route, ...]:
        """Extend the shortest chain first, so that all branches near the start are found."""
        graph, allowed = self.graph, self.graph.allowed(kinds)
        lengths = graph.lengths_m
        growing: list[tuple[float, tuple[int, ...], tuple[int, ...]]] = [
            (float(lengths[start]), (), (start,))
        ]
        done: list[tuple[tuple[int, ...], tuple[int, ...], bool]] = []
        while growing:
            length, turns, chain = heappop(growing)
            after = [row for row in graph.successors[chain[-1]] if allowed[row]]
            if length >= length_m or not after or len(chain) == _MAX_LANES:
                done.append((turns, chain, not after))
                continue
            room = MAX_ROUTES_PER_LANE - len(done) - len(growing)
            for order, row in enumerate(after[: max(room, 1)]):
                joint = np.linalg.norm(
                    graph.centerlines_m[row][0] - graph.centerlines_m[chain[-1]][-1]
                )
                heappush(
                    growing,
                    (
                        length + float(joint + lengths[row]),
                        (*turns, order),
                        (*chain, row),
                    ),
                )
        return tuple(self._joined(chain, ends) for _, chain, ends in sorted(done))

    def _joined(self, chain: tuple[int, ...], is_dead_end: bool) -> Route:
        lines = [self.graph.centerlines_m[row] for row in chain]
        points = without_repeats(np.concatenate(lines), 1e-3)
        ends: list[float] = []
        total = 0.0
        for index, line in enumerate(lines):
            if index:
                total += float(np.linalg.norm(line[0] - lines[index - 1][-1]))
            total += float(self.graph.lengths_m[chain[index]])
            ends.append(total)
        return Route(
            lane_ids=tuple(self.graph.lane_ids[row] for row in chain),
            lane_ends_m=tuple(ends),
            points_m=points,
            is_dead_end=is_dead_end,
        )


@once_per_map
def lane_routes(road_map: RoadMap) -> LaneRoutes:
    """Routes of a map."""
    return LaneRoutes(graph=lane_graph(road_map))
