"""Yielding where paths cross or merge: the agent that arrives later brakes."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.paths.car_following import (
    ACCELERATION_MPS2,
    following_acceleration,
)
from pd_editor.scene.paths.driving_paths import SPACING_M

SEARCHED_M: Final = 70.0
"""Length of path ahead of the current state that is searched for crossings."""
NUM_SEARCHED: Final = int(SEARCHED_M / SPACING_M)
CLEARANCE_M: Final = 0.4
TIME_MARGIN_S: Final = 2.0
"""A driver does not yield to agents that leave the zone this long before it enters."""
_MERGING_RAD: Final = np.radians(30)
_LEAST_MPS: Final = 0.5
_STOPS_WITHIN_MPS2: Final = 6.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """Paths ahead of A agents: points every ``SPACING_M``, NaN beyond the end."""

    x_m: Float[np.ndarray, "A W"]
    y_m: Float[np.ndarray, "A W"]
    heading_rad: Float[np.ndarray, "A W"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """C conflict zones between a driver and another agent."""

    driver: Int[np.ndarray, "C"]
    other: Int[np.ndarray, "C"]
    entry_m: Float[np.ndarray, "C"]
    """Arc length at which the driver's path enters the zone."""
    other_entry_m: Float[np.ndarray, "C"]
    other_exit_m: Float[np.ndarray, "C"]
    is_merge: Bool[np.ndarray, "C"]
    """Whether both paths run the same way in the zone, so that one agent follows."""


def find_crossings(
    tracks: Tracks, rows: Int[np.ndarray, "D"], width_m: Float[np.ndarray, "A"]
) -> Crossings:
    """Find zones ahead where a driver's path comes close to another agent's path.

    Zones that one of both occupies already are left to car following.
    """
    found: list[tuple[int, int, int, int, int, bool]] = []
    for driver, row in enumerate(rows.tolist()):
        gap_x = tracks.x_m[row, :, None] - tracks.x_m[:, None, :]
        gap_y = tracks.y_m[row, :, None] - tracks.y_m[:, None, :]
        reach = (width_m[row] + width_m) / 2 + CLEARANCE_M
        squared = gap_x**2 + gap_y**2
        close = squared < (reach**2)[:, None, None]
        close[row] = False
        mine, theirs = np.any(close, axis=2), np.any(close, axis=1)
        for other in np.flatnonzero(mine.any(1)).tolist():
            points, others = np.flatnonzero(mine[other]), np.flatnonzero(theirs[other])
            if points[0] == 0 or others[0] == 0:
                continue
            turn = (
                tracks.heading_rad[row, points[-1]]
                - tracks.heading_rad[other, others[-1]]
            )
            merges = bool(np.cos(turn) > np.cos(_MERGING_RAD))
            found.append((driver, other, points[0], others[0], others[-1], merges))
    columns = np.array(found, float).reshape(-1, 6).T
    return Crossings(
        driver=columns[0].astype(int),
        other=columns[1].astype(int),
        entry_m=columns[2] * SPACING_M,
        other_entry_m=columns[3] * SPACING_M,
        other_exit_m=columns[4] * SPACING_M,
        is_merge=columns[5].astype(bool),
    )


def yielding_acceleration(
    crossings: Crossings,
    rows: Int[np.ndarray, "D"],
    place_m: Float[np.ndarray, "A"],
    speed_mps: Float[np.ndarray, "A"],
    length_m: Float[np.ndarray, "A"],
) -> Float[np.ndarray, "D"]:
    """Largest acceleration with which each driver yields at its conflict zones.

    ``place_m`` is the distance that each agent has travelled along its path.
    """
    row, other = rows[crossings.driver], crossings.other
    mine, theirs = speed_mps[row], speed_mps[other]
    to_go = crossings.entry_m - place_m[row] - length_m[row] / 2
    other_to_go = crossings.other_entry_m - place_m[other] - length_m[other] / 2
    other_to_leave = crossings.other_exit_m - place_m[other] + length_m[other] / 2
    arrival = to_go / np.maximum(mine, _LEAST_MPS)
    other_arrival = other_to_go / np.maximum(theirs, _LEAST_MPS)
    other_gone = other_to_leave / np.maximum(theirs, _LEAST_MPS)
    other_gone = np.where(crossings.is_merge, other_arrival, other_gone)
    is_inside = (other_to_go <= 0) & (other_to_leave > 0) & ~crossings.is_merge
    comes = (theirs > _LEAST_MPS) & (other_to_go > 0)
    later = (arrival > other_arrival) | ((arrival == other_arrival) & (row > other))
    can_stop = to_go > mine**2 / (2 * _STOPS_WITHIN_MPS2)
    yields = (is_inside | (comes & later)) & (to_go > 0) & can_stop
    yields &= arrival < other_gone + TIME_MARGIN_S
    gap = np.where(yields, to_go + 1.0, np.inf)
    affordable = np.full(len(rows), ACCELERATION_MPS2)
    np.minimum.at(
        affordable,
        crossings.driver,
        following_acceleration(mine, gap, np.zeros(len(gap))),
    )
    return affordable
