"""Slows trajectories to the friction limit of their own curves."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.paths.retiming import interpolate_rows
from pd_editor.scene.perturbation.friction_slowdown import (
    ACCELERATION_MPS2,
    BRAKING_MPS2,
)

_MARGIN: Final = 0.98
"""Ratio of new speed to limit: retiming moves the points at which curvature is measured."""
_SLOWEST_MPS: Final = 0.1


def drivable_speed(
    along_m: Float[np.ndarray, "G H"], limit_mps: Float[np.ndarray, "G H"]
) -> Float[np.ndarray, "G H"]:
    """Highest speed at each point from which the limits ahead can be kept.

    Braking ahead of a limit and acceleration after it are those of normal driving.
    """
    return highest_speed(
        along_m,
        _MARGIN * limit_mps,
        braking_mps2=BRAKING_MPS2,
        acceleration_mps2=ACCELERATION_MPS2,
    )


def highest_speed(
    along_m: Float[np.ndarray, "G H"],
    limit_mps: Float[np.ndarray, "G H"],
    *,
    braking_mps2: float,
    acceleration_mps2: float,
) -> Float[np.ndarray, "G H"]:
    """Highest speed at each point that keeps all limits by braking and accelerating."""
    squared = limit_mps**2
    braking, gaining = 2 * braking_mps2 * along_m, 2 * acceleration_mps2 * along_m
    ahead = np.minimum.accumulate((squared + braking)[:, ::-1], axis=1)[:, ::-1]
    behind = np.minimum.accumulate(squared - gaining, axis=1)
    return np.sqrt(np.maximum(np.minimum(ahead - braking, behind + gaining), 0.0))


def slowed_distance(
    along_m: Float[np.ndarray, "G H"],
    speed_mps: Float[np.ndarray, "G H"],
    allowed_mps: Float[np.ndarray, "G H"],
    step_s: float,
) -> tuple[Float[np.ndarray, "G H"], Float[np.ndarray, "G H"]]:
    """Distance travelled and speed of each slowed agent at each step.

    Speed is a function of position: where it is lowered, all later points are reached
    later. Times at rest are kept.
    """
    slowed = np.minimum(speed_mps, allowed_mps)

    def middle(values: Float[np.ndarray, "G H"]) -> Float[np.ndarray, "G H-1"]:
        return np.maximum((values[:, 1:] + values[:, :-1]) / 2, _SLOWEST_MPS)

    longer = np.maximum(1 / middle(slowed) - 1 / middle(speed_mps), 0.0)
    delay = np.cumsum(np.diff(along_m, axis=1) * longer, axis=1)
    steps = np.broadcast_to(np.arange(along_m.shape[1]) * step_s, along_m.shape)
    time = steps.copy()
    time[:, 1:] += delay
    known = np.stack([along_m, slowed], axis=-1)
    reached = interpolate_rows(steps, time, known)
    return reached[..., 0], reached[..., 1]
