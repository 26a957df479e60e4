"""Keeping a gap: who is ahead on a path, and the Intelligent Driver Model.

Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and
microscopic simulations (2000).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.paths.driving_paths import SPACING_M, DrivingPaths

ACCELERATION_MPS2: Final = 1.8
COMFORTABLE_BRAKING_MPS2: Final = 2.5
HARDEST_BRAKING_MPS2: Final = 7.0
HEADWAY_S: Final = 1.4
STANDSTILL_GAP_M: Final = 2.0
LOOKAHEAD_M: Final = 60.0
SIDE_CLEARANCE_M: Final = 0.15
"""Least gap to the side at which one drives past another."""
_LEAST_GAP_M: Final = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """All A agents at one moment."""

    position_m: Float[np.ndarray, "A 2"]
    heading_rad: Float[np.ndarray, "A"]
    velocity_mps: Float[np.ndarray, "A 2"]
    size_m: Float[np.ndarray, "A 2"]
    exists: Bool[np.ndarray, "A"]


def following_acceleration(
    speed_mps: Float[np.ndarray, "..."],
    gap_m: Float[np.ndarray, "..."],
    leader_mps: Float[np.ndarray, "..."],
) -> Float[np.ndarray, "..."]:
    """Acceleration that keeps a gap (IDM); an infinite one allows the full one."""
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
    boxes: Boxes,
) -> Float[np.ndarray, "D"]:
    """Acceleration that every driver can afford behind all boxes on its path.

    A box is on the path where it and the driver's box, moved along, would touch.
    """
    num_points = paths.heading_rad.shape[1]
    window = np.arange(int(LOOKAHEAD_M / SPACING_M))
    cell = (place_m / SPACING_M).astype(int)
    index = np.minimum(cell[:, None] + window, num_points - 1)
    driver = np.arange(len(rows))[:, None]
    x, y = paths.x_m[driver, index], paths.y_m[driver, index]
    gap_x = boxes.position_m[:, 0, None] - x[:, None]
    gap_y = boxes.position_m[:, 1, None] - y[:, None]
    nearest = (gap_x**2 + gap_y**2).argmin(-1)
    at = index[driver, nearest]
    heading = paths.heading_rad[driver, at]
    cos, sin = np.cos(heading), np.sin(heading)
    other = np.arange(len(boxes.exists))
    gap_x, gap_y = gap_x[driver, other, nearest], gap_y[driver, other, nearest]
    ahead = at * SPACING_M + cos * gap_x + sin * gap_y - place_m[:, None]
    aside = np.abs(cos * gap_y - sin * gap_x)
    turn = boxes.heading_rad - heading
    across, along = np.abs(np.sin(turn)), np.abs(np.cos(turn))
    length, width = boxes.size_m.T / 2
    reach_along = along * length + across * width
    reach_aside = across * length + along * width
    is_leader = ahead > 0
    is_leader &= aside < reach_aside + width[rows, None] + SIDE_CLEARANCE_M
    is_leader &= boxes.exists & (other != rows[:, None])
    gap = np.where(is_leader, ahead - reach_along - length[rows, None], np.inf)
    speed = cos * boxes.velocity_mps[:, 0] + sin * boxes.velocity_mps[:, 1]
    affordable = following_acceleration(speed_mps[:, None], gap, speed)
    return affordable.min(1, initial=ACCELERATION_MPS2)
