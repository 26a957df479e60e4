"""Which agents are off the drivable area."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.geometry.oriented_box import box_corners
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario


@lru_cache(maxsize=16)
def drivable_ground(road_map: RoadMap) -> shapely.Geometry:
    """Union of the drivable areas; of lanes and crosswalks where a map has none.

    Prepared for many point queries, and kept as long as the map is in use.
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
    """Whether points of the scene lie outside the drivable area.

    Under a warp they are taken back and tested on the original road, so nothing has
    to be built while a road is being bent.
    """
    if scenario.applied_warp is not None:
        points_m = scenario.applied_warp.warp.undo(points_m)
    ground = drivable_ground(scenario.original_road_map)
    return ~shapely.contains_xy(ground, points_m[..., 0], points_m[..., 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class OffRoad:
    """Off-road tests of A agents at S steps; false for whom they mean nothing.

    Judged are vehicles, buses, motorcyclists and cyclists, where they exist.
    """

    is_judged: Bool[np.ndarray, "A S"]
    center: Bool[np.ndarray, "A S"]
    """Whether the box's centre is off the drivable area."""
    num_corners: Int[np.ndarray, "A S"]
    """How many corners of the box are off it."""

    def share(self) -> float:
        """Share of judged agents whose centre is off road at any of the steps."""
        judged = self.is_judged.any(axis=1)
        return float(self.center.any(axis=1).sum() / max(judged.sum(), 1))


def off_road(scenario: Scenario, steps: Int[np.ndarray, "S"]) -> OffRoad:
    """Off-road tests of all agents at some steps."""
    agents = scenario.agents
    follows = agents.kind_mask(LANE_FOLLOWER_KINDS)
    is_judged = agents.is_valid[:, steps] & follows[:, None]
    row, at = np.nonzero(is_judged)
    position = agents.position_m[row, steps[at]]
    corners = box_corners(
        position, agents.heading_rad[row, steps[at]], agents.size_m[row]
    )
    off = is_off_road(scenario, np.concatenate([position[:, None], corners], axis=1))
    center = np.zeros(is_judged.shape, bool)
    num_corners = np.zeros(is_judged.shape, int)
    center[row, at] = off[:, 0]
    num_corners[row, at] = off[:, 1:].sum(axis=1)
    return OffRoad(is_judged=is_judged, center=center, num_corners=num_corners)
