"""Camera poses that show a part of the scene."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.view_memory import Vector, ViewPose, vector

TOP_VIEW_FOV_RAD: Final = float(np.radians(8.0))
"""So narrow that a perspective camera far away looks orthographic."""
PERSPECTIVE_FOV_RAD: Final = float(np.radians(42.0))
TOP_VIEW_HALF_HEIGHT_M: Final = 65.0
LOOK_AHEAD_M: Final = 14.0
"""How far ahead of an agent the default 3-D view looks."""
BEHIND_M: Final = 48.0
ABOVE_M: Final = 34.0
MIN_EXTENT_M: Final = 28.0
"""A single parked car is not shown larger than this."""
LOWEST_RAD: Final = float(np.radians(30.0))
HIGHEST_RAD: Final = float(np.radians(65.0))
"""Flatter or steeper 3-D views are brought into this range when a part is framed."""
LOWEST_OF_MAP_RAD: Final = float(np.radians(50.0))
"""A whole map, seen flatter than this, leaves most of the picture empty."""
NARROWEST_FREE: Final = 0.45
"""So much of the picture's width is used even if elements cover more than the rest."""
MAX_WHOLE_MAP_M: Final = 1000.0
"""Of a larger map, the part with traffic is shown."""
TALLEST_M: Final = 2.0


@dataclass(frozen=True, kw_only=True)
class FreePart:
    """What elements over the picture leave free, where the picture spans -1..1."""

    left: float = -0.90
    right: float = 0.90
    bottom: float = -0.62
    top: float = 0.80

    @classmethod
    def left_of(cls, share: float) -> "FreePart":
        """What is free where an element covers all but a share of the width, left."""
        return cls(right=2.0 * min(max(share, NARROWEST_FREE), 1.0) - 1.1)

    @classmethod
    def above(cls, share: float) -> "FreePart":
        """What is free where an element covers a share of the height, at the bottom."""
        # At least this share of the picture's height is used.
        return cls(bottom=max(cls.bottom, 2.0 * min(share, 0.5) - 1.0))

    @classmethod
    def right_of(cls, share: float) -> "FreePart":
        """What is free where an element covers a share of the width, left."""
        return cls(left=2.0 * min(max(share, 0.0), 1.0 - NARROWEST_FREE) - 0.9)


FREE_PART: Final = FreePart()


def from_behind(target_m: Float[np.ndarray, "2"], heading_rad: float) -> ViewPose:
    """The default 3-D view: from above and behind a point, along a heading."""
    x, y = target_m - BEHIND_M * _direction(heading_rad)
    return ViewPose(
        position_m=(float(x), float(y), ABOVE_M),
        look_at_m=(float(target_m[0]), float(target_m[1]), 0.0),
        up=(0.0, 0.0, 1.0),
        fov_rad=PERSPECTIVE_FOV_RAD,
    )


def from_above(
    center_m: Float[np.ndarray, "2"],
    up_rad: float,
    half_height_m: float = TOP_VIEW_HALF_HEIGHT_M,
) -> ViewPose:
    """A map-like view; the direction ``up_rad`` of the scene is up in the picture."""
    x, y = float(center_m[0]), float(center_m[1])
    up_x, up_y = _direction(up_rad)
    return ViewPose(
        position_m=(x, y, float(half_height_m / np.tan(TOP_VIEW_FOV_RAD / 2))),
        look_at_m=(x, y, 0.0),
        up=(float(up_x), float(up_y), 0.0),
        fov_rad=TOP_VIEW_FOV_RAD,
    )


def fitted(
    points_m: Float[np.ndarray, "N 3"],
    *,
    forward: Vector | np.ndarray,
    up: Vector | np.ndarray,
    fov_rad: float,
    aspect: float,
    free: FreePart = FREE_PART,
) -> ViewPose:
    """The nearest pose in a direction that shows all points in the picture's free part.

    ``forward`` is downwards; ``up`` in the picture is not along it. The field of view
    is vertical; ``aspect`` is width by height.
    """
    right, upwards, ahead = _axes(forward, up)
    middle = points_m.mean(axis=0)
    across, along, depth = ((points_m - middle) @ np.stack([right, upwards, ahead]).T).T
    tan_v = np.tan(fov_rad / 2)
    tan_h = tan_v * aspect
    # A point is in the free part if its offset is between low and high times the
    # depth from the camera. Along each axis that leaves an interval of offsets of the
    # camera, which is not empty from some distance on; the larger distance rules.
    distances, ranges = [], []
    for offset, low, high in (
        (across, free.left * tan_h, free.right * tan_h),
        (along, free.bottom * tan_v, free.top * tan_v),
    ):
        least, most = (offset - depth * high).max(), (offset - depth * low).min()
        distances.append((least - most) / (high - low))
        ranges.append((least, most, low, high))
    distance = max(*distances, 1.0 - float(depth.min()))
    shift = [
        0.5 * (least + most - distance * (low + high))
        for least, most, low, high in ranges
    ]
    position = middle + shift[0] * right + shift[1] * upwards - distance * ahead
    # What is looked at lies on the ground, so that turning about it stays above.
    look_at = position + ahead * (position[2] / -ahead[2])
    look_at[2] = 0.0
    return ViewPose(
        position_m=vector(position),
        look_at_m=vector(look_at),
        up=vector(up),
        fov_rad=fov_rad,
    )


def facing_square(
    center_m: Float[np.ndarray, "3"],
    half_side_m: float,
    *,
    forward: Vector | np.ndarray,
    up: Vector | np.ndarray,
) -> Float[np.ndarray, "4 3"]:
    """Corners of a square that faces the camera: fitted, its centre is in the middle.

    A square on the ground, seen at a slant, has its centre above the middle.
    """
    right, upwards, _ = _axes(forward, up)
    return center_m + half_side_m * np.array(
        [x * right + y * upwards for x in (-1, 1) for y in (-1, 1)]
    )


def agents_extent(
    scenario: Scenario, agent_ids: Iterable[str], *, with_tracks: bool = True
) -> Float[np.ndarray, "8 3"] | None:
    """Corners of the box around agents and their trajectories; None without any.

    Without tracks, it is the box of those that are there at the current step, if any is.
    """
    agents = scenario.agents
    rows = [agents.row_of[agent] for agent in agent_ids if agent in agents.row_of]
    is_there = agents.is_valid[rows]
    if not is_there.any():
        return None
    is_now = is_there & (np.arange(agents.num_steps) == scenario.current_step)
    if is_now.any() and not with_tracks:
        is_there = is_now
    reach = np.linalg.norm(agents.size_m[rows], axis=-1)[:, None, None] / 2
    positions = agents.position_m[rows]
    low = (positions - reach)[is_there].min(axis=0)
    high = (positions + reach)[is_there].max(axis=0)
    lack = np.maximum(MIN_EXTENT_M - (high - low), 0.0) / 2
    return _corners(low - lack, high + lack)


def map_extent(scenario: Scenario) -> Float[np.ndarray, "8 3"]:
    """Corners of the box around the road, or around the traffic if it is huge."""
    points = np.concatenate(scenario.road_map.polylines)[:, :2]
    low, high = points.min(axis=0), points.max(axis=0)
    if (high - low).max() > MAX_WHOLE_MAP_M:
        traffic = agents_extent(scenario, scenario.agents.ids)
        if traffic is not None:
            return traffic
    return _corners(low, high)


def framing_direction(pose: ViewPose, lowest_rad: float = LOWEST_RAD) -> np.ndarray:
    """Where a pose looks, neither too flat nor too steep to frame a part in 3-D."""
    look = np.subtract(pose.look_at_m, pose.position_m)
    flat = look[:2]
    if np.hypot(*flat) < 1e-3 * abs(look[2]):
        flat = np.array(pose.up[:2])
    if not flat.any():
        flat = np.array([0.0, 1.0])
    elevation = np.arctan2(-look[2], np.hypot(*look[:2]))
    elevation = np.clip(elevation, lowest_rad, HIGHEST_RAD)
    return np.append(np.cos(elevation) * flat / np.hypot(*flat), -np.sin(elevation))


def _axes(
    forward: Vector | np.ndarray, up: Vector | np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the right, upwards and ahead in the picture."""
    ahead = np.asarray(forward, float) / np.linalg.norm(forward)
    right = np.cross(ahead, np.asarray(up, float))
    right /= np.linalg.norm(right)
    return right, np.cross(right, ahead), ahead


def _corners(low: np.ndarray, high: np.ndarray) -> Float[np.ndarray, "8 3"]:
    return np.array(
        [
            (x, y, z)
            for x in (low[0], high[0])
            for y in (low[1], high[1])
            for z in (0.0, TALLEST_M)
        ]
    )


def _direction(heading_rad: float) -> np.ndarray:
    return np.array([np.cos(heading_rad), np.sin(heading_rad)])
