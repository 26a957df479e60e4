"""Off-road tests against the drivable area."""

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


@dataclass(frozen=True, kw_only=True, eq=False)
class OffRoad:
    """Off-road tests of A agents at S steps; false where ``is_evaluated`` is false.

    Evaluated are vehicles, buses, motorcyclists and cyclists, where they exist.
    """

    is_evaluated: Bool[np.ndarray, "A S"]
    center: Bool[np.ndarray, "A S"]
    """Whether the box's centre is outside the drivable area."""
    num_corners: Int[np.ndarray, "A S"]
    """Number of corners of the box outside the drivable area."""

    def share(self) -> float:
        """Share of evaluated agents whose centre is off-road at any of the steps."""
        evaluated = self.is_evaluated.any(axis=1)
        return float(self.center.any(axis=1).sum() / max(evaluated.sum(), 1))


def off_road(scenario: Scenario, steps: Int[np.ndarray, "S"]) -> OffRoad:
    """Off-road tests of all agents at some steps."""
    agents = scenario.agents
    follows = agents.kind_mask(LANE_FOLLOWER_KINDS)
    is_evaluated = agents.is_valid[:, steps] & follows[:, None]
    row, at = np.nonzero(is_evaluated)
    position = agents.position_m[row, steps[at]]
    corners = box_corners(
        position, agents.heading_rad[row, steps[at]], agents.size_m[row]
    )
    off = is_off_road(scenario, np.concatenate([position[:, None], corners], axis=1))
    center = np.zeros(is_evaluated.shape, bool)
    num_corners = np.zeros(is_evaluated.shape, int)
    center[row, at] = off[:, 0]
    num_corners[row, at] = off[:, 1:].sum(axis=1)
    return OffRoad(is_evaluated=is_evaluated, center=center, num_corners=num_corners)
