"""Lanes as arrays: their segments, links and gaps; cached per road map."""

from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.scene.geometry.angles import heading_of
from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.paths.lanes.lane_search import LaneSearch
from pd_editor.scene.road_map import Lane, LaneKind, RoadMap, once_per_map

MAX_GAP_M: Final = 3.0
"""Widest gap between the end of a lane and the start of its successor."""
DEAD_END_M: Final = 100.0
"""Length by which lanes without a successor are extended for ``extended_search``."""
_REPEAT_M: Final = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneGraph:
    """The L usable lanes of a map; rows are indices into these.

    Lanes of one point, or with coordinates that are not finite, are left out.
    """

    lane_ids: tuple[int, ...]
    kinds: tuple[LaneKind, ...]
    centerlines_m: tuple[Float[np.ndarray, "_ 2"], ...]
    """Centre lines without repeated points."""
    successors: tuple[tuple[int, ...], ...]
    """Rows of the lanes that follow within ``MAX_GAP_M``, straightest first."""
    neighbors: tuple[tuple[int, ...], ...]
    """Rows of the neighbouring lanes, left one first, in either driving direction."""

    @cached_property
    def row_of(self) -> dict[int, int]:
        """Row of each lane id."""
        return {lane_id: row for row, lane_id in enumerate(self.lane_ids)}

    @cached_property
    def lengths_m(self) -> Float[np.ndarray, "L"]:
        """Length of each centre line."""
        search, count = self.search, len(self.lane_ids)
        return np.bincount(search.lane, weights=search.length_m, minlength=count)

    @cached_property
    def search(self) -> LaneSearch:
        """Search among every segment of every centre line."""
        lines = Lines.of(self.centerlines_m)
        keep = np.diff(lines.line) == 0
        start, step = lines.points_m[:-1][keep], np.diff(lines.points_m, axis=0)[keep]
        length, lane = np.hypot(*step.T), lines.line[:-1][keep]
        before = np.cumsum(length) - length
        first = lines.ends[0] - np.arange(len(lines.count))
        return LaneSearch(
            start_m=start,
            direction=step / length[:, None],
            length_m=length,
            lane=lane,
            along_m=before - before[first][lane],
        )

    @cached_property
    def extended_search(self) -> LaneSearch:
        """Search in which lanes without a successor go straight on."""
        search = self.search
        is_dead_end = np.array([not after for after in self.successors], bool)
        length = search.length_m.copy()
        length[search.last_of_lane[is_dead_end]] += DEAD_END_M
        return replace(search, length_m=length)

    def allowed(self, kinds: tuple[LaneKind, ...]) -> Bool[np.ndarray, "L"]:
        """Whether each lane is of one of the kinds."""
        return np.array([kind in kinds for kind in self.kinds], bool)


@once_per_map
def lane_graph(road_map: RoadMap) -> LaneGraph:
    """The graph of a map."""
    lanes, lines = _usable(road_map.lanes)
    row_of = {lane.lane_id: row for row, lane in enumerate(lanes)}
    return LaneGraph(
        lane_ids=tuple(lane.lane_id for lane in lanes),
        kinds=tuple(lane.kind for lane in lanes),
        centerlines_m=tuple(lines),
        successors=_near_successors(lanes, lines, row_of),
        neighbors=tuple(
            tuple(
                row_of[side]
                for side in (lane.left_neighbor, lane.right_neighbor)
                if side is not None and side in row_of and side != lane.lane_id
            )
            for lane in lanes
        ),
    )


def _usable(all_lanes: tuple[Lane, ...]) -> tuple[list[Lane], list[np.ndarray]]:
    """Usable lanes, and their centre lines without repeated points."""
    lanes = [lane for lane in all_lanes if len(lane.centerline) >= 2]
    if not lanes:
        return [], []
    lines = Lines.of([lane.centerline_m for lane in lanes])
    is_finite = np.isfinite(lines.points_m)
    is_usable = np.logical_and.reduceat(is_finite.all(axis=1), lines.ends[0])
    finite = replace(lines, points_m=np.where(is_finite, lines.points_m, 0.0))
    kept = finite.without_repeats(_REPEAT_M)
    rows = np.flatnonzero(is_usable & (kept.count >= 2)).tolist()
    parts = kept.apart()
    return [lanes[row] for row in rows], [parts[row] for row in rows]


def _near_successors(
    lanes: list[Lane], lines: list[np.ndarray], row_of: dict[int, int]
) -> tuple[tuple[int, ...], ...]:
    links = {
        (row, row_of[other])
        for row, lane in enumerate(lanes)
        for other in lane.successors
        if other in row_of
    } | {
        (row_of[other], row)
        for row, lane in enumerate(lanes)
        for other in lane.predecessors
        if other in row_of
    }
    found: list[list[tuple[float, int, int]]] = [[] for _ in lanes]
    if links:
        pairs = np.array(sorted(links))
        firsts = np.array([[line[0], line[1]] for line in lines])
        lasts = np.array([[line[-2], line[-1]] for line in lines])
        here, there = lasts[pairs[:, 0]], firsts[pairs[:, 1]]
        gap = np.linalg.norm(there[:, 0] - here[:, 1], axis=-1)
        turn = heading_of(there[:, 1] - there[:, 0]) - heading_of(
            here[:, 1] - here[:, 0]
        )
        bend = np.abs((turn + np.pi) % (2 * np.pi) - np.pi).round(6)
        for (row, other), is_near, angle in zip(
            pairs.tolist(), (gap <= MAX_GAP_M).tolist(), bend.tolist(), strict=True
        ):
            if is_near:
                found[row].append((angle, lanes[other].lane_id, other))
    return tuple(tuple(other for *_, other in sorted(item)) for item in found)


def lane_chain(
    road_map: RoadMap,
    first_id: int,
    last_id: int,
    *,
    kinds: tuple[LaneKind, ...],
) -> tuple[int, ...] | None:
    """Ids of the fewest lanes that follow one another from a lane to another one.

    Both ends are included. None if the last lane is not reached without a lane change.
    """
    graph = lane_graph(road_map)
    if first_id not in graph.row_of or last_id not in graph.row_of:
        return None
    allowed = graph.allowed(kinds)
    first, last = graph.row_of[first_id], graph.row_of[last_id]
    came_from: dict[int, int | None] = {first: None}
    waiting = deque([first])
    while waiting and last not in came_from:
        row = waiting.popleft()
        for after in graph.successors[row]:
            if allowed[after] and after not in came_from:
                came_from[after] = row
                waiting.append(after)
    if last not in came_from:
        return None
    chain: list[int] = []
    at: int | None = last
    while at is not None:
        chain.append(graph.lane_ids[at])
        at = came_from[at]
    return tuple(reversed(chain))
