"""Ways back of boxes that leave the road."""

from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.metrics.road.off_road import drivable_ground, is_off_road
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

_LENGTHWISE: Final = 0.8
"""Share of a way along an agent's heading from which on the map ends there."""


def way_back_m(
    scenario: Scenario,
    corners_m: Float[np.ndarray, "*s T 4 2"],
    heading_rad: Float[np.ndarray, "*s T"],
) -> Float[np.ndarray, "*s T 4 2"]:
    """Vectors from boxes' corners to the road's edge at T steps; zero on the road.

    From the step on at which an agent leaves the road ahead or behind they are zero: there
    the map ends.
    """
    way = np.zeros(corners_m.shape)
    off = is_off_road(scenario, corners_m)
    if off.any():
        way[off] = _nearest_on_edge(scenario, corners_m[off]) - corners_m[off]
        ahead = unit_vector(heading_rad)
        lengthwise = np.abs((way * ahead[..., None, :]).sum(-1))
        ends = (lengthwise > _LENGTHWISE * np.linalg.norm(way, axis=-1)).any(axis=-1)
        way[np.maximum.accumulate(ends, axis=-1)] = 0.0
    return way


def _nearest_on_edge(
    scenario: Scenario, points_m: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "N 2"]:
    """Nearest point of the road's edge to each point."""
    lines = shapely.shortest_line(_edge(scenario.road_map), shapely.points(points_m))
    return shapely.get_coordinates(shapely.get_point(lines, 0))


@lru_cache(maxsize=16)
def _edge(road_map: RoadMap) -> shapely.Geometry:
    """Edge of the road, cached as long as the map is in use."""
    edge = shapely.boundary(drivable_ground(road_map))
    shapely.prepare(edge)
    return edge
