"""Distance of points outside the road, and the nearest points on it."""

from functools import lru_cache

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.metrics.road.off_road import drivable_ground, is_off_road
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario


def outside_m(
    scenario: Scenario, points_m: Float[np.ndarray, "*s 2"]
) -> Float[np.ndarray, "*s"]:
    """Distance of each point to the road; 0 on it."""
    distance = np.zeros(points_m.shape[:-1])
    off = is_off_road(scenario, points_m)
    if off.any():
        gap = nearest_on_road(scenario, points_m[off]) - points_m[off]
        distance[off] = np.linalg.norm(gap, axis=-1)
    return distance


def nearest_on_road(
    scenario: Scenario, points_m: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "N 2"]:
    """Nearest point of the road's edge to each point.

    Under a warp points are mapped back, and the edge's points forth again.
    """
    applied = scenario.applied_warp
    local = points_m if applied is None else applied.warp.undo(points_m)
    lines = shapely.shortest_line(
        _edge(scenario.original_road_map), shapely.points(local)
    )
    nearest = shapely.get_coordinates(shapely.get_point(lines, 0))
    return nearest if applied is None else applied.warp.apply(nearest)


@lru_cache(maxsize=16)
def _edge(road_map: RoadMap) -> shapely.Geometry:
    """Edge of the road, cached as long as the map is in use."""
    edge = shapely.boundary(drivable_ground(road_map))
    shapely.prepare(edge)
    return edge
