"""Lanes as arrays: their segments, links and gaps; cached per road map."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.angles import heading_of
from pd_editor.scene.road_map import Lane, LaneKind, RoadMap

MAX_GAP_M: Final = 3.0
"""Widest gap between the end of a lane and the start of its successor."""
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
        segments = self.segments
        return np.bincount(
            segments.lane, weights=segments.length_m, minlength=len(self.lane_ids)
        )

    @cached_property
    def segments(self) -> "LaneSegments":
        """Every segment of every centre line."""
        counts = np.array([len(line) for line in self.centerlines_m], int)
        if not len(counts):
            none = np.zeros((0, 2))
            return LaneSegments(
                start_m=none, end_m=none, lane=counts, along_m=np.zeros(0)
            )
        points = np.concatenate(self.centerlines_m)
        lane = np.repeat(np.arange(len(counts)), counts)
        keep = lane[:-1] == lane[1:]
        start, end = points[:-1][keep], points[1:][keep]
        before = np.cumsum(np.hypot(*(end - start).T)) - np.hypot(*(end - start).T)
        lane = lane[:-1][keep]
        first = np.concatenate([[0], np.cumsum(counts - 1)[:-1]])
        return LaneSegments(
            start_m=start, end_m=end, lane=lane, along_m=before - before[first][lane]
        )

    def allowed(self, kinds: tuple[LaneKind, ...]) -> Bool[np.ndarray, "L"]:
        """Whether each lane is of one of the kinds."""
        return np.array([kind in kinds for kind in self.kinds], bool)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSegments:
    """S straight segments of centre lines, lane after lane."""

    start_m: Float[np.ndarray, "S 2"]
    end_m: Float[np.ndarray, "S 2"]
    lane: Int[np.ndarray, "S"]
    """Row of the lane in the graph."""
    along_m: Float[np.ndarray, "S"]
    """Arc length along the lane at which the segment starts."""

    @cached_property
    def length_m(self) -> Float[np.ndarray, "S"]:
        """Length of each segment."""
        return np.hypot(*(self.end_m - self.start_m).T)

    @cached_property
    def direction(self) -> Float[np.ndarray, "S 2"]:
        """Unit vector along each segment."""
        return (self.end_m - self.start_m) / self.length_m[:, None]

    @cached_property
    def heading_rad(self) -> Float[np.ndarray, "S"]:
        """Direction of each segment."""
        return heading_of(self.direction)

    def squared_m2(
        self,
        points_m: Float[np.ndarray, "*#s 2"],
        segment: Int[np.ndarray, "*#s"],
        length_m: Float[np.ndarray, "S"] | None = None,
    ) -> Float[np.ndarray, "*s"]:
        """Squared distances of points to segments; the two shapes are broadcast.

        ``length_m`` replaces the lengths of all segments.
        """
        length = self.length_m if length_m is None else length_m
        start, direction = self.start_m[segment], self.direction[segment]
        dx = points_m[..., 0] - start[..., 0]
        dy = points_m[..., 1] - start[..., 1]
        along = dx * direction[..., 0]
        along += dy * direction[..., 1]
        np.clip(along, 0.0, length[segment], out=along)
        dx -= along * direction[..., 0]
        dy -= along * direction[..., 1]
        dx *= dx
        dy *= dy
        dx += dy
        return dx

    @cached_property
    def circles_m(
        self,
    ) -> tuple[Float[np.ndarray, "S"], Float[np.ndarray, "S"], Float[np.ndarray, "S"]]:
        """Slightly enlarged circles around the segments: x, y of the centre, radius."""
        x, y = (self.start_m + self.end_m).T / 2
        return x.copy(), y.copy(), self.length_m / 2 + 1e-6

    @cached_property
    def lane_bounds_m(
        self,
    ) -> tuple[Float[np.ndarray, "L 2"], Float[np.ndarray, "L 2"]]:
        """Least and greatest coordinates of each lane's centre line."""
        first = self.first_of_lane
        return (
            np.minimum.reduceat(np.minimum(self.start_m, self.end_m), first),
            np.maximum.reduceat(np.maximum(self.start_m, self.end_m), first),
        )

    @cached_property
    def first_of_lane(self) -> Int[np.ndarray, "L"]:
        """Index of each lane's first segment."""
        return np.flatnonzero(np.diff(self.lane, prepend=-1))


_graphs: WeakKeyDictionary[RoadMap, LaneGraph] = WeakKeyDictionary()


def lane_graph(road_map: RoadMap) -> LaneGraph:
    """The graph of a map, built once per map value."""
    graph = _graphs.get(road_map)
    if graph is None:
        graph = _graphs[road_map] = _build(road_map)
    return graph


def _build(road_map: RoadMap) -> LaneGraph:
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
    points = np.concatenate([lane.centerline_m for lane in lanes])
    ends = np.cumsum([len(lane.centerline) for lane in lanes])
    starts = np.concatenate([[0], ends[:-1]])
    is_finite = np.logical_and.reduceat(np.isfinite(points).all(axis=1), starts)
    points = np.where(np.isfinite(points), points, 0.0)
    step = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    kept = np.concatenate([[True], step > _REPEAT_M])
    kept[starts] = True
    counts = np.add.reduceat(kept.astype(int), starts)
    parts = np.split(points[kept], np.cumsum(counts)[:-1])
    rows = np.flatnonzero(is_finite & (counts >= 2)).tolist()
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
