"""Speed profiles along paths with bounded acceleration and speed limits in curves."""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.scene.paths.car_following import BoxesAhead, following_acceleration
from pd_editor.scene.paths.driving_paths import SPACING_M, DrivingPaths

MAX_BRAKING_MPS2: Final = 4.0
RESPONSE_S: Final = 0.8
"""Time constant with which a speed approaches its target."""


def drive(
    paths: DrivingPaths,
    path: Int[np.ndarray, "K"],
    *,
    speed_mps: Float[np.ndarray, "K"],
    target_mps: Float[np.ndarray, "K"],
    most_mps2: Float[np.ndarray, "2 K"],
    num_steps: int,
    step_s: float,
    leaders: BoxesAhead | None = None,
) -> Float[np.ndarray, "K {num_steps}+1"]:
    """Distance travelled along a path at each step, given an initial speed.

    The speed approaches its target with at most the acceleration and braking in
    ``most_mps2``, and brakes for curves with at most ``MAX_BRAKING_MPS2``. Drivers with a leader, which
    keeps its speed, also keep a gap to it (IDM); ``leaders.driver`` indexes K.
    """
    num_points = paths.heading_rad.shape[1]
    limits = paths.speed_limit_mps.ravel()
    base = path * num_points
    speed, place = speed_mps.copy(), np.zeros(len(path))
    reached = np.zeros((num_steps + 1, len(path)))
    scale, response = 1 / SPACING_M, step_s / RESPONSE_S
    most, least = most_mps2[0] * step_s, -most_mps2[1] * step_s
    # First row: change of speed for the target; second row: for the curves.
    wanted = np.stack([target_mps, target_mps])
    lowest = np.stack([least, np.minimum(least, -MAX_BRAKING_MPS2 * step_s)])
    seen, cell = np.empty((2, len(path))), np.empty((2, len(path)), np.int64)
    for step in range(num_steps):
        np.multiply(speed, RESPONSE_S, out=seen[1])
        seen[1] += place
        seen[0] = place
        seen *= scale
        cell[...] = seen
        np.minimum(cell, num_points - 1, out=cell)
        cell += base
        limit = limits.take(cell)
        np.minimum(limit[0], limit[1], out=wanted[1])
        change = wanted - speed
        change *= response
        np.maximum(change, lowest, out=change)
        np.minimum(change[0], most, out=change[0])
        if leaders is not None:
            _keep_gap(change[0], leaders, place, speed, step * step_s, step_s)
        new = np.minimum(change[0], change[1])
        new += speed
        np.maximum(new, 0.0, out=new)
        speed += new
        speed *= step_s / 2
        place += speed
        reached[step + 1] = place
        speed = new
    return np.ascontiguousarray(reached.T)


def _keep_gap(
    change: Float[np.ndarray, "K"],
    leaders: BoxesAhead,
    place_m: Float[np.ndarray, "K"],
    speed_mps: Float[np.ndarray, "K"],
    time_s: float,
    step_s: float,
) -> None:
    """Limit the changes of speed of drivers that follow a leader (IDM), in place."""
    index = leaders.driver
    gap = leaders.gap_m + leaders.speed_mps * time_s - place_m[index]
    allowed = following_acceleration(speed_mps[index], gap, leaders.speed_mps)
    change[index] = np.minimum(change[index], allowed * step_s)
