"""Search of centre lines by points and by the paths of many agents."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.lines import numbered
from pd_editor.scene.geometry.path_pieces import (
    PathPieces,
    in_pieces,
    joined_pieces,
    rectangles_meet,
)

WRONG_WAY_M: Final = 5.0
"""Extra distance up to which a lane is preferred to one in the opposite direction."""
_SPARE_M: Final = 3.0
"""Reach of the fast search beyond an agent's initial distance to its lanes."""
_SLACK_M: Final = 1e-6
_CHUNK: Final = 100_000
"""Pairs of point and lane per chunk; their arrays fit into the cache."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NearbyLanes:
    """Pairs of a point and a lane within reach, sorted by point, then by distance."""

    point: Int[np.ndarray, "Q"]
    lane: Int[np.ndarray, "Q"]
    """Row of the lane in the lane graph."""
    distance_m: Float[np.ndarray, "Q"]
    offset_m: Float[np.ndarray, "Q"]
    """Offset to the left of the lane."""
    along_m: Float[np.ndarray, "Q"]
    """Arc length of the foot; below 0 or above the lane's length past its ends."""
    turn_rad: Float[np.ndarray, "Q"]
    """Heading at the point minus the lane's direction, in (-pi, pi]."""
    is_beside: Bool[np.ndarray, "Q"]
    """False where the point is before the lane's start or past its end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSearch:
    """S straight segments of centre lines, lane after lane; every lane has some."""

    start_m: Float[np.ndarray, "S 2"]
    direction: Float[np.ndarray, "S 2"]
    """Unit vector along each segment."""
    length_m: Float[np.ndarray, "S"]
    lane: Int[np.ndarray, "S"]
    """Row of the lane in the graph."""
    along_m: Float[np.ndarray, "S"]
    """Arc length along the lane at which the segment starts."""

    @cached_property
    def heading_rad(self) -> Float[np.ndarray, "S"]:
        """Direction of each segment."""
        return heading_of(self.direction)

    @cached_property
    def first_of_lane(self) -> Int[np.ndarray, "L"]:
        """Index of each lane's first segment."""
        return np.flatnonzero(np.diff(self.lane, prepend=-1))

    @cached_property
    def last_of_lane(self) -> Int[np.ndarray, "L"]:
        """Index of each lane's last segment."""
        return np.flatnonzero(np.diff(self.lane, append=len(self.lane)))

    def nearest(
        self,
        points_m: Float[np.ndarray, "N 2"],
        lanes: Bool[np.ndarray, "N L"],
        heading_rad: Float[np.ndarray, "N"] | None = None,
    ) -> tuple[Float[np.ndarray, "N"], Int[np.ndarray, "N"]]:
        """Distance to, and index of, the nearest segment among each point's lanes.

        Given headings, a lane within 90 degrees of the heading is preferred to one in
        the opposite direction unless it is ``WRONG_WAY_M`` further away. Each point
        must have at least one lane.
        """
        middle_m = self.start_m[(self.first_of_lane + self.last_of_lane) // 2]
        more_m = _SLACK_M + (0.0 if heading_rad is None else WRONG_WAY_M)
        chunk = max(1, _CHUNK // len(middle_m))
        best, distance = np.zeros(len(points_m), int), np.zeros(len(points_m))
        for start in range(0, len(points_m), chunk):
            part = slice(start, start + chunk)
            here, usable = points_m[part], lanes[part]
            # No lane is searched that is further than a point of another one.
            x, y = (here[:, None] - middle_m).T
            reach = np.where(usable, np.hypot(x, y).T, np.inf).min(axis=1) + more_m
            point, segment = self._pairs(
                here - reach[:, None], here + reach[:, None], usable
            )
            far = np.sqrt(self._squared_m2(here[point], segment))
            cost = far
            if heading_rad is not None:
                facing, ahead = unit_vector(heading_rad[part])[point], self.direction
                cosine = (facing * ahead[segment]).sum(axis=-1)
                cost = far + np.where(cosine > 0, 0.0, WRONG_WAY_M)
            # Of equally near ones the first.
            order = np.lexsort((cost, point))
            first = order[np.diff(point[order], prepend=-1) != 0]
            best[part], distance[part] = segment[first], far[first]
        return distance, best

    def in_reach(
        self,
        points_m: Float[np.ndarray, "N 2"],
        heading_rad: Float[np.ndarray, "N"],
        lanes: Bool[np.ndarray, "N L"],
        reach_m: float,
    ) -> NearbyLanes:
        """Find each point's lanes within reach and 90 degrees of its heading."""
        point, segment = self._pairs(points_m - reach_m, points_m + reach_m, lanes)
        x, y, radius = self._circles_m
        gap_x = points_m[:, 0].take(point) - x.take(segment)
        gap_y = points_m[:, 1].take(point) - y.take(segment)
        far = radius.take(segment) + reach_m
        near = np.flatnonzero(gap_x * gap_x + gap_y * gap_y <= far * far)
        point, segment = point[near], segment[near]
        direction, length = self.direction[segment], self.length_m[segment]
        rel = points_m[point] - self.start_m[segment]
        x = rel[:, 0] * direction[:, 0] + rel[:, 1] * direction[:, 1]
        side = direction[:, 0] * rel[:, 1] - direction[:, 1] * rel[:, 0]
        foot = np.clip(x, 0.0, length)
        distance = np.hypot(x - foot, side)
        facing = unit_vector(heading_rad)[point]
        cosine = facing[:, 0] * direction[:, 0] + facing[:, 1] * direction[:, 1]
        near = np.flatnonzero((distance <= reach_m) & (cosine > 0))
        point, segment, x, side = point[near], segment[near], x[near], side[near]
        length, foot, distance = length[near], foot[near], distance[near]
        lane = self.lane[segment]
        order = np.lexsort((segment, distance.round(9), lane, point))
        pair = point[order] * len(self.first_of_lane) + lane[order]
        first = order[np.diff(pair, prepend=-1) != 0]
        first = first[np.lexsort((lane[first], distance[first].round(9), point[first]))]
        lane, segment, x = lane[first], segment[first], x[first]
        is_before = (segment == self.first_of_lane[lane]) & (x < 0)
        is_past = (segment == self.last_of_lane[lane]) & (x > length[first])
        is_beside = ~(is_before | is_past)
        return NearbyLanes(
            point=point[first],
            lane=lane,
            distance_m=distance[first],
            offset_m=np.where(
                is_beside, np.copysign(distance[first], side[first]), side[first]
            ),
            along_m=self.along_m[segment] + np.where(is_beside, foot[first], x),
            turn_rad=wrap_angle(heading_rad[point[first]] - self.heading_rad[segment]),
            is_beside=is_beside,
        )

    def nearest_on_paths(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        is_valid: Bool[np.ndarray, "A H"],
        lanes: Bool[np.ndarray, "A L"],
    ) -> tuple[Float[np.ndarray, "A H"], Int[np.ndarray, "A H"]]:
        """Distance to, and index of, the nearest segment among each agent's lanes.

        Each agent with a valid step must have at least one lane.
        """
        row, first_step = np.flatnonzero(is_valid.any(axis=1)), is_valid.argmax(axis=1)
        first_m = position_m[np.arange(len(position_m)), first_step]
        reach = np.zeros(len(position_m))
        reach[row] = self.nearest(first_m[row], lanes[row])[0] if len(row) else 0.0
        offset = position_m - first_m[:, None]
        excursion = np.where(is_valid, np.hypot(offset[..., 0], offset[..., 1]), 0.0)
        reach += np.minimum(excursion.max(axis=1, initial=0.0), _SPARE_M) + 1e-6
        pieces = PathPieces.of(position_m, is_valid, reach)
        distance = np.full(pieces.is_valid.shape, np.inf)
        found = np.zeros(pieces.is_valid.shape, int)
        piece, segment, squared = self._near_pieces(pieces, lanes)
        if len(piece):
            first = np.flatnonzero(np.diff(piece, prepend=-1))
            least = np.minimum.reduceat(squared, first, axis=0)
            distance[piece[first]] = np.sqrt(least)
            number = np.append(first[1:], len(piece)) - first
            pair, step = np.nonzero(squared == np.repeat(least, number, axis=0))
            found[piece[pair], step] = segment[pair]
        distance = joined_pieces(distance, is_valid.shape[1])
        found = joined_pieces(found, is_valid.shape[1])
        row, step = np.nonzero(is_valid & ~(distance <= reach[:, None]))
        if len(row):
            distance[row, step], found[row, step] = self.nearest(
                position_m[row, step], lanes[row]
            )
        return np.where(is_valid, distance, 0.0), found

    def is_near_paths(
        self,
        position_m: Float[np.ndarray, "A H 2"],
        heading_rad: Float[np.ndarray, "A H"],
        is_valid: Bool[np.ndarray, "A H"],
        lanes: Bool[np.ndarray, "A L"],
        reach_m: float,
    ) -> tuple[Bool[np.ndarray, "A H"], Bool[np.ndarray, "A H"]]:
        """Whether any segment, and any within 90 degrees of the heading, is in reach."""
        pieces = PathPieces.of(position_m, is_valid, np.full(len(lanes), reach_m))
        below = np.zeros(pieces.is_valid.shape, bool)
        along = np.zeros(pieces.is_valid.shape, bool)
        piece, segment, squared = self._near_pieces(pieces, lanes)
        if len(piece):
            near = squared <= reach_m**2
            first = np.flatnonzero(np.diff(piece, prepend=-1))
            owner = piece[first]
            below[owner] = np.logical_or.reduceat(near, first, axis=0)
            ux, uy = self.direction[segment].T[:, :, None]
            heading = in_pieces(heading_rad).reshape(pieces.is_valid.shape)
            x, y = np.cos(heading), np.sin(heading)
            near &= x[piece] * ux + y[piece] * uy > 0
            along[owner] = np.logical_or.reduceat(near, first, axis=0)
        num_steps = is_valid.shape[1]
        return (
            joined_pieces(below & pieces.is_valid, num_steps),
            joined_pieces(along & pieces.is_valid, num_steps),
        )

    def _near_pieces(
        self, pieces: PathPieces, lanes: Bool[np.ndarray, "A L"]
    ) -> tuple[Int[np.ndarray, "Q"], Int[np.ndarray, "Q"], Float[np.ndarray, "Q _"]]:
        """Pieces with segments of their agents' lanes in reach, and squared distances."""
        agent, segment = self._pairs(*pieces.path_bounds_m, lanes)
        piece, segment = pieces.near_boxes(agent, segment, *self._bounds_m)
        position_m = pieces.position_m[piece]
        return piece, segment, self._squared_m2(position_m, segment[:, None])

    def _pairs(
        self,
        low_m: Float[np.ndarray, "N 2"],
        high_m: Float[np.ndarray, "N 2"],
        lanes: Bool[np.ndarray, "N L"],
    ) -> tuple[Int[np.ndarray, "Q"], Int[np.ndarray, "Q"]]:
        """Pairs of an axis-aligned box and a segment of its lanes that meet it."""
        first = self.first_of_lane
        least, greatest = self._lane_bounds_m
        meet = rectangles_meet(low_m[:, None], high_m[:, None], least, greatest)
        box, lane = np.nonzero(lanes & meet)
        pair, within = numbered((self.last_of_lane + 1 - first)[lane])
        return box[pair], first[lane][pair] + within

    def _squared_m2(
        self, points_m: Float[np.ndarray, "*#s 2"], segment: Int[np.ndarray, "*#s"]
    ) -> Float[np.ndarray, "*s"]:
        """Squared distances of points to segments; the two shapes are broadcast."""
        start, direction = self.start_m[segment], self.direction[segment]
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

    @cached_property
    def _bounds_m(self) -> tuple[Float[np.ndarray, "S 2"], Float[np.ndarray, "S 2"]]:
        """Least and greatest coordinates of each segment."""
        end = self.start_m + self.length_m[:, None] * self.direction
        return np.minimum(self.start_m, end), np.maximum(self.start_m, end)

    @cached_property
    def _lane_bounds_m(
        self,
    ) -> tuple[Float[np.ndarray, "L 2"], Float[np.ndarray, "L 2"]]:
        """Least and greatest coordinates of each lane's centre line."""
        low, high = self._bounds_m
        return (
            np.minimum.reduceat(low, self.first_of_lane),
            np.maximum.reduceat(high, self.first_of_lane),
        )

    @cached_property
    def _circles_m(
        self,
    ) -> tuple[Float[np.ndarray, "S"], Float[np.ndarray, "S"], Float[np.ndarray, "S"]]:
        """Slightly enlarged circles around the segments: x, y of the centre, radius."""
        x, y = (self.start_m + self.direction * self.length_m[:, None] / 2).T
        return x.copy(), y.copy(), self.length_m / 2 + 1e-6
