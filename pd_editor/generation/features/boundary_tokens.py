"""Map tokens of the drivable area's boundary: pieces of about 10 m."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float, Int

from pd_editor.analysis.metrics.road import drivable_ground
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

BOUNDARY_LENGTH_M: Final = 10.0
BOUNDARY_SHAPE: Final = ("length", "turn_before", "turn", "turn_after")
"""Length in tens of metres; turns of the previous piece, of the piece itself and of the
next one, in radians, positive to the left."""
MIRRORED_BOUNDARY: Final = (0, 3, 2, 1)
"""Index of the feature that replaces each one of ``BOUNDARY_SHAPE`` in a mirrored scene,
where pieces run the other way, since the drivable area stays on their left."""

_CLOSED_GAP_M: Final = 0.3
"""Areas nearer to each other than twice this are merged: maps have gaps between them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryPieces:
    """E pieces of the drivable area's boundary, with the area on their left."""

    pose: Float[np.ndarray, "E 3"]
    """Midpoint of each piece in the scene frame, and its direction."""
    shape: Float[np.ndarray, "E 4"]
    """Features named by ``BOUNDARY_SHAPE``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _DividedBoundary:
    """Start, midpoint and end of each piece, with the previous and next pieces."""

    points_m: Float[np.ndarray, "E 3 2"]
    before: Int[np.ndarray, "E"]
    after: Int[np.ndarray, "E"]


def boundary_pieces(scenario: Scenario) -> BoundaryPieces:
    """Pieces of a scenario's road; under a warp, the warped pieces of the original road."""
    cut = _cut(scenario.original_road_map)
    points = cut.points_m
    if scenario.applied_warp is not None and len(points):
        points = scenario.applied_warp.warp.apply(points)
    start, middle, end = points[:, 0], points[:, 1], points[:, 2]
    first, last = middle - start, end - middle
    turn = np.clip(2 * wrap_angle(heading_of(last) - heading_of(first)), -np.pi, np.pi)
    length = np.hypot(*first.T) + np.hypot(*last.T)
    return BoundaryPieces(
        pose=np.column_stack([middle, heading_of(end - start)]),
        shape=np.column_stack(
            [length / BOUNDARY_LENGTH_M, turn[cut.before], turn, turn[cut.after]]
        ),
    )


@lru_cache(maxsize=16)
def _cut(road_map: RoadMap) -> _DividedBoundary:
    """Divide the boundary of a map's drivable area; cached as long as the map is in use."""
    points: list[np.ndarray] = [np.zeros((0, 3, 2))]
    before: list[np.ndarray] = [np.zeros(0, int)]
    after: list[np.ndarray] = [np.zeros(0, int)]
    count = 0
    for ring in _rings(road_map):
        step = np.diff(ring, axis=0)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
        number = max(round(along[-1] / BOUNDARY_LENGTH_M), 2)
        at = (np.arange(number)[:, None] + np.array([0.0, 0.5, 1.0])) / number
        at *= along[-1]
        points.append(
            np.stack([np.interp(at, along, ring[:, axis]) for axis in (0, 1)], axis=-1)
        )
        index = count + np.arange(number)
        before.append(np.roll(index, 1))
        after.append(np.roll(index, -1))
        count += number
    return _DividedBoundary(
        points_m=np.concatenate(points),
        before=np.concatenate(before),
        after=np.concatenate(after),
    )


def _rings(road_map: RoadMap) -> list[Float[np.ndarray, "N 2"]]:
    """Closed rings around the drivable area, and reversed rings around its holes."""
    ground = drivable_ground(road_map)
    closed = shapely.buffer(ground, _CLOSED_GAP_M, join_style="mitre")
    closed = shapely.buffer(closed, -_CLOSED_GAP_M, join_style="mitre")
    rings: list[np.ndarray] = []
    for part in shapely.get_parts(closed):
        # Small parts and holes are left out.
        if part.area < 20.0:
            continue
        ground_left = shapely.geometry.polygon.orient(part)
        holes = [
            one for one in ground_left.interiors if shapely.Polygon(one).area >= 4.0
        ]
        rings += [
            np.asarray(one.coords)[:, :2] for one in (ground_left.exterior, *holes)
        ]
    return rings
