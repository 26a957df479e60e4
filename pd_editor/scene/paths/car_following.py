"""Car following: leaders on a path, and the Intelligent Driver Model (IDM).

Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and
microscopic simulations (2000).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.driving_paths import SPACING_M, DrivingPaths

ACCELERATION_MPS2: Final = 1.8
COMFORTABLE_BRAKING_MPS2: Final = 2.5
HARDEST_BRAKING_MPS2: Final = 7.0
HEADWAY_S: Final = 1.4
STANDSTILL_GAP_M: Final = 2.0
LOOKAHEAD_M: Final = 60.0
SIDE_CLEARANCE_M: Final = 0.15
"""Least lateral gap at which an agent passes another one."""
_LEAST_GAP_M: Final = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingBoxes(Boxes):
    """Boxes of all A agents at one step, with their velocities."""

    velocity_mps: Float[np.ndarray, "A 2"]
    exists: Bool[np.ndarray, "A"]


def following_acceleration(
    speed_mps: Float[np.ndarray, "..."],
    gap_m: Float[np.ndarray, "..."],
    leader_mps: Float[np.ndarray, "..."],
) -> Float[np.ndarray, "..."]:
    """IDM acceleration for a gap; an infinite gap allows the full acceleration."""
    closing = speed_mps * (speed_mps - leader_mps)
    closing = closing / (2 * np.sqrt(ACCELERATION_MPS2 * COMFORTABLE_BRAKING_MPS2))
    wanted = STANDSTILL_GAP_M + np.maximum(speed_mps * HEADWAY_S + closing, 0.0)
    ratio = wanted / np.maximum(gap_m, _LEAST_GAP_M)
    return np.maximum(ACCELERATION_MPS2 * (1 - ratio**2), -HARDEST_BRAKING_MPS2)


def leaders_acceleration(
    paths: DrivingPaths,
    place_m: Float[np.ndarray, "D"],
    speed_mps: Float[np.ndarray, "D"],
    rows: Int[np.ndarray, "D"],
    boxes: MovingBoxes,
) -> Float[np.ndarray, "D"]:
    """IDM acceleration of each driver, the least over all boxes on its path."""
    ahead = boxes_ahead(paths, np.arange(len(rows)), place_m, rows, boxes)
    affordable = np.full(len(rows), ACCELERATION_MPS2)
    allowed = following_acceleration(
        speed_mps[ahead.driver], ahead.gap_m, ahead.speed_mps
    )
    np.minimum.at(affordable, ahead.driver, allowed)
    return affordable


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxesAhead:
    """N pairs of a driver and a box on its path, sorted by driver."""

    driver: Int[np.ndarray, "N"]
    gap_m: Float[np.ndarray, "N"]
    """Free length of path between both boxes."""
    speed_mps: Float[np.ndarray, "N"]

    def nearest(self) -> "BoxesAhead":
        """Keep only the nearest box of each driver."""
        order = np.lexsort((self.gap_m, self.driver))
        first = order[np.diff(self.driver[order], prepend=-1) != 0]
        return BoxesAhead(
            driver=self.driver[first],
            gap_m=self.gap_m[first],
            speed_mps=self.speed_mps[first],
        )


def boxes_ahead(
    paths: DrivingPaths,
    path: Int[np.ndarray, "D"],
    place_m: Float[np.ndarray, "D"],
    rows: Int[np.ndarray, "D"],
    boxes: MovingBoxes,
) -> BoxesAhead:
    """Find the boxes on the paths of drivers, within ``LOOKAHEAD_M``.

    A box is on the path if the driver's box, moved along the path, would touch it.
    ``rows`` are those of the drivers among the boxes.
    """
    num_points = paths.heading_rad.shape[1]
    window = np.arange(int(LOOKAHEAD_M / SPACING_M))
    cell = (place_m / SPACING_M).astype(int)
    index = np.minimum(cell[:, None] + window, num_points - 1)
    index += (path * num_points)[:, None]
    x, y = paths.x_m.take(index), paths.y_m.take(index)
    reach = np.hypot(*boxes.size_m.T) / 2
    margin = reach + (boxes.size_m[rows, 1] / 2 + SIDE_CLEARANCE_M)[:, None]
    near = boxes.exists & (np.arange(len(boxes.exists)) != rows[:, None])
    for axis, values in enumerate((x, y)):
        position = boxes.position_m[:, axis]
        near &= position > values.min(axis=1, initial=np.inf)[:, None] - margin
        near &= position < values.max(axis=1, initial=-np.inf)[:, None] + margin
    driver, other = np.nonzero(near)
    gap_x = boxes.position_m[other, 0, None] - x[driver]
    gap_y = boxes.position_m[other, 1, None] - y[driver]
    nearest = (gap_x**2 + gap_y**2).argmin(-1) if len(driver) else driver
    pair = np.arange(len(driver))
    gap_x, gap_y = gap_x[pair, nearest], gap_y[pair, nearest]
    at = index[driver, nearest]
    heading = paths.heading_rad.take(at)
    at = at - path[driver] * num_points
    cos, sin = np.cos(heading), np.sin(heading)
    ahead = at * SPACING_M + cos * gap_x + sin * gap_y - place_m[driver]
    aside = np.abs(cos * gap_y - sin * gap_x)
    turn = boxes.heading_rad[other] - heading
    across, along = np.abs(np.sin(turn)), np.abs(np.cos(turn))
    length, width = boxes.size_m[other].T / 2
    own_length, own_width = boxes.size_m[rows[driver]].T / 2
    reach_along = along * length + across * width
    reach_aside = across * length + along * width
    leads = (ahead > 0) & (aside < reach_aside + own_width + SIDE_CLEARANCE_M)
    speed = cos * boxes.velocity_mps[other, 0] + sin * boxes.velocity_mps[other, 1]
    return BoxesAhead(
        driver=driver[leads],
        gap_m=(ahead - reach_along - own_length)[leads],
        speed_mps=speed[leads],
    )
