"""Crops a road map to the surroundings of paths, as Argoverse 2 maps are cropped."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float, Int

from pd_editor.scene.road_map import DrivableArea, RoadMap

MAP_MARGIN_M: Final = 35.0
"""Lanes within this distance of a path are in the map."""
_AREA_MARGIN_M: Final = 15.0
"""Drivable areas are clipped at this distance outside the lanes."""
_MIN_AREA_M2: Final = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _MapIndex:
    """Searchable geometry of a map's lanes, crosswalks and drivable areas."""

    lanes: shapely.STRtree
    crosswalks: shapely.STRtree
    areas: shapely.STRtree


@lru_cache(maxsize=16)
def _index_of(road_map: RoadMap) -> _MapIndex:
    lines = [shapely.LineString(lane.centerline_m) for lane in road_map.lanes]
    crossings = [shapely.Polygon(one.outline_m()) for one in road_map.crosswalks]
    rings = [shapely.Polygon(one.boundary) for one in road_map.drivable_areas]
    return _MapIndex(
        lanes=shapely.STRtree(lines),
        crosswalks=shapely.STRtree(shapely.make_valid(crossings)),
        areas=shapely.STRtree(shapely.make_valid(rings)),
    )


def cropped_map(road_map: RoadMap, paths_m: Float[np.ndarray, "M T 2"]) -> RoadMap:
    """Crop a map to lanes, crosswalks and areas within ``MAP_MARGIN_M`` of paths."""
    index = _index_of(road_map)
    paths = shapely.MultiLineString(list(paths_m))

    def near(tree: shapely.STRtree) -> Int[np.ndarray, "K"]:
        found = tree.query(paths, predicate="dwithin", distance=MAP_MARGIN_M)
        return np.sort(found)

    rows = near(index.lanes)
    return RoadMap(
        lanes=tuple(road_map.lanes[row] for row in rows),
        crosswalks=tuple(road_map.crosswalks[row] for row in near(index.crosswalks)),
        drivable_areas=_ground(road_map, index, rows, near(index.areas)),
        source_fields=road_map.source_fields,
    )


def _ground(
    road_map: RoadMap,
    index: _MapIndex,
    lane_rows: Int[np.ndarray, "L"],
    rows: Int[np.ndarray, "K"],
) -> tuple[DrivableArea, ...]:
    """Drivable areas, clipped where they extend far beyond the lanes."""
    if not len(lane_rows) or not len(rows):
        return ()
    bounds = shapely.total_bounds(index.lanes.geometries[lane_rows])
    frame = bounds + _AREA_MARGIN_M * np.array([-1, -1, 1, 1])
    shapes = index.areas.geometries[rows]
    extent = shapely.bounds(shapes)
    reaches_out = (extent[:, :2] < frame[:2]).any(axis=1)
    reaches_out |= (extent[:, 2:] > frame[2:]).any(axis=1)
    kept = [road_map.drivable_areas[row] for row in rows[~reaches_out]]
    cut = shapely.intersection(shapes[reaches_out], shapely.box(*frame))
    next_id = max(area.area_id for area in road_map.drivable_areas) + 1
    for part in shapely.get_parts(cut):
        if isinstance(part, shapely.Polygon) and part.area > _MIN_AREA_M2:
            ring = shapely.get_coordinates(part.exterior, include_z=True)[:-1]
            kept.append(DrivableArea(area_id=next_id, boundary=ring))
            next_id += 1
    return tuple(kept)
