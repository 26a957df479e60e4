"""From latents of futures to places, headings and velocities in a scene."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.diffusion.inputs.trajectory_pca import TrajectoryBasis, heading_along
from pd_editor.geometry.angles import unit_vector
from pd_editor.scene.time_axis import TimeAxis

_STANDS_MPS: Final = 0.3
_STAYS_M: Final = 0.5
"""Who stands and would not even move this far stays where it is, exactly."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """S samples of A agents at the current step and F later ones."""

    position_m: Float[np.ndarray, "S A F_plus_1 2"]
    heading_rad: Float[np.ndarray, "S A F_plus_1"]
    velocity_mps: Float[np.ndarray, "S A F_plus_1 2"]


def motion_of(
    basis: TrajectoryBasis,
    latent: Float[np.ndarray, "S A 10"],
    position_m: Float[np.ndarray, "A 2"],
    heading_rad: Float[np.ndarray, "A"],
    velocity_mps: Float[np.ndarray, "A 2"],
    axis: TimeAxis,
) -> Motion:
    """Futures that begin exactly at the given states.

    Beyond the basis' last step agents keep their last velocity.
    """
    speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    local = np.pad(basis.decode(latent, speed), [(0, 0), (0, 0), (1, 0), (0, 0)])
    reach = np.hypot(local[..., 0], local[..., 1]).max(axis=-1)
    stays = (speed < _STANDS_MPS) & (reach < _STAYS_M)
    local = np.where(stays[..., None, None], 0.0, local)
    local = _at_steps(local, basis.step_s, axis)
    forward = unit_vector(heading_rad)[:, None]
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    position = position_m[:, None] + local[..., :1] * forward + local[..., 1:] * left
    first = np.broadcast_to(heading_rad, position.shape[:2])
    heading = heading_along(position, first)
    velocity = np.zeros_like(position)
    if axis.num_future_steps:
        velocity = np.gradient(position, axis.step_s, axis=-2)
    velocity[..., 0, :] = velocity_mps
    return Motion(position_m=position, heading_rad=heading, velocity_mps=velocity)


def _at_steps(
    local: Float[np.ndarray, "S A H 2"], step_s: float, axis: TimeAxis
) -> Float[np.ndarray, "S A F_plus_1 2"]:
    """Points at the steps of a time axis, between those of the basis or beyond."""
    place = np.arange(axis.num_future_steps + 1) * (axis.step_s / step_s)
    before = np.minimum(place.astype(int), local.shape[-2] - 2)
    fraction = (place - before)[:, None]
    return local[..., before, :] * (1 - fraction) + local[..., before + 1, :] * fraction
