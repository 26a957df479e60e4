"""Union of paved shapes, as rings without holes."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

_GAP_M: Final = 0.4
"""Gaps between shapes up to twice this width are closed."""
_SPIKE_M: Final = 0.2
"""Parts narrower than twice this width are removed."""
_SIMPLIFY_M: Final = 0.05
_MIN_AREA_M2: Final = 4.0
_MIN_HOLE_M2: Final = 40.0
"""Smaller holes are filled."""


def paved_rings(shapes: Iterable[BaseGeometry]) -> list[Float[np.ndarray, "_ 2"]]:
    """Open rings that together cover all shapes, with small gaps closed."""
    paved = shapely.union_all(list(shapes))
    for swell in (_GAP_M, -_GAP_M - _SPIKE_M, _SPIKE_M):
        paved = paved.buffer(swell, join_style="mitre", mitre_limit=1.5)
    paved = paved.simplify(_SIMPLIFY_M)
    return [
        np.asarray(ring.exterior.coords)[:-1, :2]
        for polygon in _polygons(paved, _MIN_AREA_M2)
        for ring in _without_holes(polygon)
    ]


def valid_area(points_m: Float[np.ndarray, "N 2"]) -> BaseGeometry:
    """Area inside an open ring, which may cross itself."""
    return shapely.make_valid(Polygon(points_m))


def _polygons(shape: BaseGeometry, least_m2: float) -> list[Polygon]:
    parts = [shape] if isinstance(shape, Polygon) else list(getattr(shape, "geoms", ()))
    return [
        part for part in parts if isinstance(part, Polygon) and part.area > least_m2
    ]


def _without_holes(polygon: Polygon) -> list[Polygon]:
    """Divide a polygon through its holes until none is left."""
    holes = [Polygon(ring) for ring in polygon.interiors]
    holes = [hole for hole in holes if hole.area > _MIN_HOLE_M2]
    if not holes:
        return [Polygon(polygon.exterior)]
    x = max(holes, key=lambda hole: hole.area).centroid.x
    west, south, east, north = polygon.bounds
    result: list[Polygon] = []
    for half in (
        box(west - 1, south - 1, x, north + 1),
        box(x, south - 1, east + 1, north + 1),
    ):
        for part in _polygons(polygon.intersection(half), 0.0):
            result += _without_holes(part)
    return result
