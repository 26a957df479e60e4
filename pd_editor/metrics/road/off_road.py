"""Off-road tests against the drivable area."""

from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

MAX_WAY_TO_ROAD_M: Final = 5.0
"""Largest distance over which an agent is moved back onto the road."""


@lru_cache(maxsize=16)
def drivable_ground(road_map: RoadMap) -> shapely.Geometry:
    """Union of the drivable areas; of lanes and crosswalks where a map has none.

    Prepared for many point queries, and cached as long as the map is in use.
    """
    if road_map.drivable_areas:
        rings = [area.boundary[:, :2] for area in road_map.drivable_areas]
    else:
        rings = [lane.outline_m() for lane in road_map.lanes]
        rings += [crosswalk.outline_m() for crosswalk in road_map.crosswalks]
    areas = [shapely.Polygon(ring) for ring in rings if len(ring) >= 3]
    ground = shapely.union_all(shapely.make_valid(np.array(areas, object)))
    shapely.prepare(ground)
    return ground


def is_off_road(
    scenario: Scenario, points_m: Float[np.ndarray, "*s 2"]
) -> Bool[np.ndarray, "*s"]:
    """Whether points of the scene are outside the drivable area.

    Under a warp they are mapped back and tested on the original road, so that no
    geometry has to be built while a warp is being edited.
    """
    if scenario.applied_warp is not None:
        points_m = scenario.applied_warp.warp.undo(points_m)
    ground = drivable_ground(scenario.original_road_map)
    return ~shapely.contains_xy(ground, points_m[..., 0], points_m[..., 1])


def nearest_on_road(
    scenario: Scenario, point_m: Float[np.ndarray, "2"], inside_m: float
) -> Float[np.ndarray, "2"] | None:
    """Nearest point that is ``inside_m`` within the drivable area; None if none is near.

    Under a warp it is looked for on the original road.
    """
    applied, points = scenario.applied_warp, point_m[None]
    if applied is not None:
        points = applied.warp.undo(points)
    point = shapely.Point(points[0])
    around = point.buffer(MAX_WAY_TO_ROAD_M + 2 * inside_m)
    near = shapely.intersection(drivable_ground(scenario.original_road_map), around)
    inner = shapely.buffer(near, -inside_m)
    if inner.is_empty or point.distance(inner) > MAX_WAY_TO_ROAD_M:
        return None
    found = shapely.get_coordinates(shapely.shortest_line(inner, point))[:1]
    return (found if applied is None else applied.warp.apply(found))[0]
