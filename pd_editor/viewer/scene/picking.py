"""Picking: the agent or lane under the pointer."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_map import Lane, RoadMap
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.scene.camera import ground_point

REACH: Final = 0.005
"""Share of the distance by which an agent is enlarged for the pointer: some pixels."""
MAX_COORDINATE_M: Final = 1e7


@dataclass(frozen=True, kw_only=True, eq=False)
class PointerRay:
    """A position of the pointer on the picture, and the ray that goes through it."""

    x_px: float
    y_px: float
    origin_m: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]

    @classmethod
    def of_event(cls, event: Mapping[str, Any]) -> "PointerRay | None":
        """Ray of a page's event; None if the event has no valid one."""
        at, ray = event.get("at"), event.get("ray")
        if not (isinstance(ray, list) and len(ray) == 2):
            return None
        position, origin, beyond = (
            _numbers(at, 2),
            _numbers(ray[0], 3),
            _numbers(ray[1], 3),
        )
        if position is None or origin is None or beyond is None:
            return None
        direction = beyond - origin
        length = float(np.linalg.norm(direction))
        if length == 0.0:
            return None
        return cls(
            x_px=float(position[0]),
            y_px=float(position[1]),
            origin_m=origin,
            direction=direction / length,
        )

    @property
    def ground_m(self) -> Float[np.ndarray, "2"] | None:
        """Intersection with the ground; None for the sky."""
        return ground_point(self.origin_m, self.direction)


def point_of(value: Any) -> Float[np.ndarray, "2"] | None:
    """Point of the ground that a page sent; None if it is not valid."""
    return _numbers(value, 2)


def number_of(value: Any) -> float | None:
    """A finite number that a page sent; None if it is none."""
    found = _numbers([value], 1)
    return None if found is None else float(found[0])


def _numbers(value: Any, count: int) -> np.ndarray | None:
    if not isinstance(value, list) or len(value) != count:
        return None
    # Comparing first: integers of any size, and NaN fails every comparison.
    if not all(
        isinstance(item, int | float)
        and not isinstance(item, bool)
        and abs(item) <= MAX_COORDINATE_M
        for item in value
    ):
        return None
    return np.array(value, float)


def agent_under(agents: AgentTracks, poses: AgentPoses, ray: PointerRay) -> int | None:
    """Row of the nearest agent whose box a ray meets."""
    if not len(agents):
        return None
    heights = np.array([DEFAULT_HEIGHT_M[kind] for kind in agents.kinds])
    cos, sin = np.cos(poses.heading_rad), np.sin(poses.heading_rad)
    offset = ray.origin_m[:2] - poses.position_m
    dx, dy, dz = ray.direction
    # In each agent's own frame, where its box is parallel to the axes.
    start = np.stack(
        [
            cos * offset[:, 0] + sin * offset[:, 1],
            cos * offset[:, 1] - sin * offset[:, 0],
            np.full(len(agents), ray.origin_m[2]) - heights / 2,
        ],
        axis=-1,
    )
    along = np.stack(
        [cos * dx + sin * dy, cos * dy - sin * dx, np.full(len(agents), dz)], axis=-1
    )
    distance = np.linalg.norm(start, axis=-1)
    half = np.column_stack([agents.size_m, heights]) / 2
    half = np.maximum(half, 0.3) + (REACH * np.minimum(distance, 150.0))[:, None] / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - start) / along, (half - start) / along
    near = np.nanmax(np.minimum(one, other), axis=-1)
    far = np.nanmin(np.maximum(one, other), axis=-1)
    is_hit = poses.is_present & (near <= far) & (far > 0)
    return int(np.where(is_hit, near, np.inf).argmin()) if is_hit.any() else None


_trees: WeakKeyDictionary[RoadMap, shapely.STRtree] = WeakKeyDictionary()


def lane_under(road_map: RoadMap, point_m: Float[np.ndarray, "2"]) -> Lane | None:
    """Lane that contains a point; of several the one with the nearest centre line."""
    tree = _trees.get(road_map)
    if tree is None:
        areas = [shapely.Polygon(lane.outline_m()) for lane in road_map.lanes]
        tree = _trees[road_map] = shapely.STRtree(shapely.make_valid(areas))
    point = shapely.Point(*map(float, point_m))
    found = tree.query(point, predicate="intersects")
    lanes = [road_map.lanes[index] for index in found]
    return min(
        lanes,
        key=lambda lane: shapely.LineString(lane.centerline_m).distance(point),
        default=None,
    )
