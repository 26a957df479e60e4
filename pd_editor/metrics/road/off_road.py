"""Off-road tests against the drivable area."""

from functools import lru_cache

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario


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
