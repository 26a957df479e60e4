"""Drivable areas of a SUMO net, as rings without holes."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import shapely
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from pd_editor.experiments.synthesis.sumo.sumo_net import SumoNet
from pd_editor.experiments.synthesis.sumo_to_av2.parking_bays import ParkingBay
from pd_editor.scene.road_map import DrivableArea, Lane

_GAP_M: Final = 0.4
"""Gaps between lanes up to twice this width are closed."""
_SPIKE_M: Final = 0.2
"""Parts narrower than twice this width are removed."""
_MITRE_LIMIT: Final = 1.5
_SIMPLIFY_M: Final = 0.05
_MIN_AREA_M2: Final = 4.0
_MIN_HOLE_M2: Final = 40.0
"""Smaller holes are filled."""


def drivable_areas(
    net: SumoNet, lanes: tuple[Lane, ...], bays: Iterable[ParkingBay], first_id: int
) -> tuple[DrivableArea, ...]:
    """Drivable areas: lanes, parking strips, bays and junctions, without sidewalks."""
    ground = [_valid(lane.outline_m()) for lane in lanes]
    ground += [
        shapely.LineString(lane.shape_m).buffer(lane.width_m / 2, cap_style="flat")
        for lane in net.lanes.values()
        if lane.is_parking
    ]
    ground += [shapely.make_valid(bay.area()) for bay in bays]
    junctions = shapely.union_all(
        [_valid(area) for area in net.junction_areas_m.values() if len(area) > 2]
    )
    pavements = shapely.union_all(
        [_valid(area) for area in net.walking_areas_m if len(area) > 2]
    )
    paved = shapely.union_all([*ground, junctions.difference(pavements)])
    for swell in (_GAP_M, -_GAP_M - _SPIKE_M, _SPIKE_M):
        paved = paved.buffer(swell, join_style="mitre", mitre_limit=_MITRE_LIMIT)
    paved = paved.simplify(_SIMPLIFY_M)
    rings = [
        ring
        for polygon in _polygons(paved, _MIN_AREA_M2)
        for ring in _without_holes(polygon)
    ]
    return tuple(
        DrivableArea(
            area_id=first_id + number,
            boundary=np.column_stack(
                [
                    np.asarray(ring.exterior.coords)[:-1],
                    np.zeros(len(ring.exterior.coords) - 1),
                ]
            ),
        )
        for number, ring in enumerate(rings)
    )


def _valid(points_m: np.ndarray) -> BaseGeometry:
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
