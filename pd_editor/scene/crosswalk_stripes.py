"""Zebra stripes of crosswalks, as flat meshes."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry
from shapely.validation import make_valid

from pd_editor.scene.road_map import Crosswalk, RoadMap

STRIPE_M: Final = 0.5
"""Width of the stripes and of the gaps between them."""
MIN_STRIPE_AREA_M2: Final = 0.3
"""Smaller rests of a stripe, at the ends of a crossing, are left out."""
_PIECE_M: Final = 2.0
"""Stripes bend with a warp in pieces of this length."""


def crosswalk_stripes(road_map: RoadMap) -> Iterator[shapely.Polygon]:
    """Parallel stripes of every crossing, on the drivable area only.

    Where two crossings overlap, the larger one has the ground, so that stripes of
    different directions never interleave.
    """
    areas = [_polygon(area.boundary[:, :2]) for area in road_map.drivable_areas]
    drivable = shapely.union_all(areas) if areas else None
    outlines = [_polygon(crossing.outline_m()) for crossing in road_map.crosswalks]
    taken: BaseGeometry = shapely.Polygon()
    for index in np.argsort([-outline.area for outline in outlines], kind="stable"):
        region = outlines[index]
        if drivable is not None:
            region = region & drivable
        free = region - taken
        taken = taken | region
        yield from _stripes(free, _direction(road_map.crosswalks[index]))


def _polygon(ring_m: Float[np.ndarray, "N 2"]) -> BaseGeometry:
    return make_valid(shapely.Polygon(ring_m)) if len(ring_m) >= 3 else shapely.Point()


def _direction(crossing: Crosswalk) -> Float[np.ndarray, "2"]:
    """Unit vector along the stripes: from one edge to the other, as traffic drives."""
    count = len(crossing.edge1)
    ring = crossing.outline_m()
    one, two = ring[:count], ring[count:][::-1]
    sides = np.stack([two[0] - one[0], two[-1] - one[-1]])
    sides /= np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-9)
    along = sides.sum(axis=0)
    return along / max(float(np.linalg.norm(along)), 1e-9)


def _stripes(
    region: BaseGeometry, along: Float[np.ndarray, "2"]
) -> Iterable[shapely.Polygon]:
    if region.is_empty or region.area < MIN_STRIPE_AREA_M2:
        return ()
    across = np.array([-along[1], along[0]])
    corners = shapely.get_coordinates(region)
    (low, high), (start, end) = (
        (float((corners @ axis).min()), float((corners @ axis).max()))
        for axis in (across, along)
    )
    count = max(round((high - low) / STRIPE_M - 1) // 2 + 1, 1)
    first = (low + high - (2 * count - 1) * STRIPE_M) / 2
    offset = first + 2 * STRIPE_M * np.arange(count)
    box = [(0.0, start), (STRIPE_M, start), (STRIPE_M, end), (0.0, end)]
    bands = np.stack(
        [(offset + v)[:, None] * across + u * along for v, u in box], axis=1
    )
    pieces = shapely.get_parts(shapely.intersection(shapely.polygons(bands), region))
    is_stripe = shapely.get_type_id(pieces) == shapely.GeometryType.POLYGON
    is_stripe &= shapely.area(pieces) >= MIN_STRIPE_AREA_M2
    return shapely.segmentize(pieces[is_stripe], _PIECE_M)
