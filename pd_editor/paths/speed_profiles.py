"""Speeds over time along paths, with bounded acceleration, slow in curves."""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.paths.driving_paths import SPACING_M, DrivingPaths

MAX_ACCELERATION_MPS2: Final = 2.5
MAX_BRAKING_MPS2: Final = 4.0
RESPONSE_S: Final = 0.8
"""Time constant with which a speed nears its target."""


def drive(
    paths: DrivingPaths,
    path: Int[np.ndarray, "K"],
    *,
    speed_mps: Float[np.ndarray, "K"],
    target_mps: Float[np.ndarray, "K"],
    acceleration_mps2: Float[np.ndarray, "K"],
    braking_mps2: Float[np.ndarray, "K"],
    num_steps: int,
    step_s: float,
) -> Float[np.ndarray, "K {num_steps}+1"]:
    """Distance reached on a path at each step, from its start at a speed.

    The speed nears its target with at most the acceleration and braking given, and
    brakes for curves with at most ``MAX_BRAKING_MPS2``.
    """
    num_points = paths.heading_rad.shape[1]
    limits = paths.speed_limit_mps.ravel()
    base = path * num_points
    speed, place = speed_mps.copy(), np.zeros(len(path))
    reached = np.zeros((len(path), num_steps + 1))
    scale, response = 1 / SPACING_M, step_s / RESPONSE_S
    most, least = acceleration_mps2 * step_s, -braking_mps2 * step_s
    hardest = np.minimum(least, -MAX_BRAKING_MPS2 * step_s)
    for step in range(num_steps):
        here = np.minimum((place * scale).astype(np.int64), num_points - 1)
        ahead = ((place + speed * RESPONSE_S) * scale).astype(np.int64)
        np.minimum(ahead, num_points - 1, out=ahead)
        limit = np.minimum(limits.take(base + here), limits.take(base + ahead))
        change = np.minimum(np.maximum((target_mps - speed) * response, least), most)
        curve = np.maximum((limit - speed) * response, hardest)
        new = np.maximum(speed + np.minimum(change, curve), 0.0)
        place = place + (speed + new) * (step_s / 2)
        speed = new
        reached[:, step + 1] = place
    return reached
