"""The paper's map points, to which its road metrics measure distances.

As in QCNet: every polyline without its last point; centre lines of all lanes, and the
midline of each crosswalk in both directions.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.angles import heading_of
from pd_editor.scene.geometry.path_pieces import (
    PathPieces,
    joined_pieces,
    rectangles_meet,
)
from pd_editor.scene.geometry.polyline import resample
from pd_editor.scene.road_map import Crosswalk, RoadMap, once_per_map

_MIDLINE_SPACING_M: Final = 2.0
_CHUNK: Final = 400_000
"""Pairs of points per chunk."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapPoints:
    """P centre points with the direction of their lines; B boundary points."""

    center_m: Float[np.ndarray, "P 2"]
    heading_rad: Float[np.ndarray, "P"]
    boundary_m: Float[np.ndarray, "B 2"]


def nearest_points(
    points_m: Float[np.ndarray, "N 2"], targets_m: Float[np.ndarray, "P 2"]
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Index of, and distance to, the nearest of at least one target."""
    count = len(points_m)
    chunk = max(1, _CHUNK // len(targets_m))
    nearest = np.zeros(count, int)
    for start in range(0, count, chunk):
        part = points_m[start : start + chunk]
        squared = (part[:, :1] - targets_m[:, 0]) ** 2
        squared += (part[:, 1:] - targets_m[:, 1]) ** 2
        nearest[start : start + chunk] = squared.argmin(axis=1)
    offset = points_m - targets_m[nearest]
    return nearest, np.hypot(offset[:, 0], offset[:, 1])


def paths_within(
    position_m: Float[np.ndarray, "A S 2"],
    is_valid: Bool[np.ndarray, "A S"],
    targets_m: Float[np.ndarray, "P 2"],
    reach_m: float,
) -> Bool[np.ndarray, "A S"]:
    """Whether any target is within reach of each agent at each step."""
    pieces = PathPieces.of(position_m, is_valid, np.full(len(position_m), reach_m))
    low, high = pieces.path_bounds_m
    agent, target = np.nonzero(
        rectangles_meet(low[:, None], high[:, None], targets_m, targets_m)
    )
    piece, target = pieces.near_boxes(agent, target, targets_m, targets_m)
    result = np.zeros(pieces.is_valid.shape, bool)
    if len(piece):
        position = pieces.position_m[piece]
        squared = (position[..., 0] - targets_m[target, 0, None]) ** 2
        squared += (position[..., 1] - targets_m[target, 1, None]) ** 2
        first = np.flatnonzero(np.diff(piece, prepend=-1))
        least = np.minimum.reduceat(squared, first, axis=0)
        result[piece[first]] = least <= reach_m**2
    return joined_pieces(result & pieces.is_valid, is_valid.shape[1])


@once_per_map
def map_points(road_map: RoadMap) -> MapPoints:
    """Points of a map."""
    centers = [lane.centerline_m for lane in road_map.lanes]
    for crosswalk in road_map.crosswalks:
        midline = _midline(crosswalk)
        centers += [midline, midline[::-1]]
    boundaries = [
        line for lane in road_map.lanes for line in (lane.left_m, lane.right_m)
    ]
    for crosswalk in road_map.crosswalks:
        edges = crosswalk.edge1[:, :2], crosswalk.edge2[:, :2]
        boundaries += [*edges, *(edge[::-1] for edge in edges)]
    nothing = np.zeros((0, 2))
    return MapPoints(
        center_m=np.concatenate([nothing, *(line[:-1] for line in centers)]),
        heading_rad=np.concatenate(
            [np.zeros(0), *(heading_of(np.diff(line, axis=0)) for line in centers)]
        ),
        boundary_m=np.concatenate([nothing, *(line[:-1] for line in boundaries)]),
    )


def _midline(crosswalk: Crosswalk) -> Float[np.ndarray, "N 2"]:
    """Line midway between both edges, with points about 2 m apart."""
    one, two = crosswalk.edge1[:, :2], crosswalk.edge2[:, :2]
    start, end = (one[0] + two[0]) / 2, (one[-1] + two[-1]) / 2
    num_points = int(np.ceil(np.hypot(*(end - start)) / _MIDLINE_SPACING_M)) + 1
    return (resample(one, max(num_points, 2)) + resample(two, max(num_points, 2))) / 2
