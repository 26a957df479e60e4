"""Decoding of latents to positions, headings and velocities."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.analysis.metrics.motion import MAX_CURVATURE_PER_M
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.inputs import (
    NUM_ACROSS,
    NUM_ALONG,
    TrajectoryBasis,
    heading_along,
)
from pd_editor.scene.geometry.angles import left_of, unit_vector, wrap_angle
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.scene.time_axis import TimeAxis

STAYS_M: Final = 0.5
"""A stationary agent that would move less than this stays exactly at its position."""
_BEGINS_S: Final = 0.6
"""Time constant with which trajectories leave the velocity of their current state."""
_WALKING_MPS: Final = 1.5
_CATCHES_UP_1PM: Final = 1.0
"""Turn per metre of a vehicle that is faster, and whose heading is not its course yet."""


class TrajectoryDecoder(nn.Module):
    """A trajectory basis as tensors, stored with the weights."""

    def __init__(self, basis: TrajectoryBasis | None, num_steps: int) -> None:
        """Make a decoder; without a basis, one must be loaded with the weights."""
        super().__init__()
        arrays = _empty(num_steps) if basis is None else basis.arrays()
        for name, values in arrays.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    @property
    def num_steps(self) -> int:
        """Number of future points."""
        return len(self.get_buffer("mean_m"))

    @property
    def basis(self) -> TrajectoryBasis:
        """The basis as NumPy arrays."""
        return TrajectoryBasis.of_arrays(
            {
                name: values.double().cpu().numpy()
                for name, values in self.named_buffers()
            }
        )

    def matrix(self, steps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Matrix [10 2T], mean [2T] and times [2T] for x and then y at T steps.

        Points are ``latent @ matrix + mean + speed * times``.
        """
        buffers = dict(self.named_buffers())
        scale = buffers["scale_m"][:, None]
        along = buffers["along"][:, steps] * scale[:NUM_ALONG]
        across = buffers["across"][:, steps] * scale[NUM_ALONG:]
        empty = torch.zeros_like(along)
        matrix = torch.cat(
            [torch.cat([along, empty], 1), torch.cat([empty[:NUM_ACROSS], across], 1)]
        )
        mean = buffers["mean_m"][steps]
        times = buffers["step_s"] * (steps + 1)
        still = torch.zeros_like(mean)
        return matrix, torch.cat([mean, still]), torch.cat([times, still])

    def still(self, speed: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape 10"]:
        """Latents of a stationary trajectory."""
        buffers = dict(self.named_buffers())
        along = buffers["along"] / buffers["scale_m"][:NUM_ALONG, None]
        steps = torch.arange(1, self.num_steps + 1, device=speed.device)
        times = buffers["step_s"] * steps.to(speed)
        back = -(speed[..., None] * (along @ times) + along @ buffers["mean_m"])
        return nn.functional.pad(back, (0, NUM_ACROSS))

    def points(
        self,
        latent: Float[Tensor, "*shape 10"],
        speed: Float[Tensor, "*#shape"],
        steps: Tensor,
    ) -> tuple[Float[Tensor, "*shape T"], Float[Tensor, "*shape T"]]:
        """Positions x and y at some steps, in each agent's own frame."""
        matrix, mean, times = self.matrix(steps)
        points = latent.to(matrix) @ matrix + mean + speed[..., None] * times
        x, y = points.chunk(2, dim=-1)
        return x, y


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Motion of A agents in S samples, at the current step and F later ones."""

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
    """Decode trajectories that begin exactly at the given states and velocities.

    Beyond the last step of the basis, agents keep their last velocity.
    """
    speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    local = np.pad(basis.decode(latent, speed), [(0, 0), (0, 0), (1, 0), (0, 0)])
    reach = np.hypot(local[..., 0], local[..., 1]).max(axis=-1)
    stays = (speed < STANDING_MPS) & (reach < STAYS_M)
    local = np.where(stays[..., None, None], 0.0, local)
    local = _at_steps(local, basis.step_s, axis)
    forward = unit_vector(heading_rad)[:, None]
    first_mps = np.stack(
        [
            (velocity_mps * forward[:, 0]).sum(axis=-1),
            (velocity_mps * left_of(forward[:, 0])).sum(axis=-1),
        ],
        axis=-1,
    )
    if axis.num_future_steps >= 3:
        time_s = axis.step_s * np.arange(axis.num_future_steps + 1)
        ahead = local - time_s[:, None] * first_mps[:, None]
        shares = jump_shares(axis.num_future_steps, axis.step_s)
        jump = np.einsum("ht,...hd->...td", shares, ahead[..., 1:4, :])
        local[..., 1:, :] -= np.where(stays[..., None, None], 0.0, jump)
    position = position_m[:, None] + local[..., :1] * forward
    position += local[..., 1:] * left_of(forward)
    first = np.broadcast_to(heading_rad, position.shape[:2])
    heading = heading_along(position, first)
    velocity = np.zeros_like(position)
    if axis.num_future_steps:
        velocity = np.gradient(position, axis.step_s, axis=-2)
    velocity[..., 0, :] = velocity_mps
    return Motion(position_m=position, heading_rad=heading, velocity_mps=velocity)


def turned_as_vehicles(
    motion: Motion, is_vehicle: Bool[np.ndarray, "A"], step_s: float
) -> Motion:
    """Motion in which no vehicle slower than walking turns on the spot.

    It turns no more than it can for the way that it covers. Where its path bends more
    sharply, its heading follows later, the faster the sooner.
    """
    way = np.linalg.norm(np.diff(motion.position_m, axis=-2), axis=-1)
    is_slow = way < _WALKING_MPS * step_s
    most = np.where(is_slow, MAX_CURVATURE_PER_M, _CATCHES_UP_1PM) * way
    most[:, ~is_vehicle] = np.pi
    heading = motion.heading_rad.copy()
    for step in range(way.shape[-1]):
        turn = wrap_angle(heading[..., step + 1] - heading[..., step])
        possible = np.clip(turn, -most[..., step], most[..., step])
        later = wrap_angle(heading[..., step] + possible)
        heading[..., step + 1] = np.where(
            possible == turn, heading[..., step + 1], later
        )
    return replace(motion, heading_rad=heading)


def jump_shares(num_steps: int, step_s: float) -> Float[np.ndarray, "3 H"]:
    """What trajectories leap by at the current step, fading out over the later ones.

    Ten components describe six seconds and do not begin at just the current place and
    velocity. Shares of the first three differences from constant velocity.
    """
    time_s = step_s * np.arange(1, num_steps + 1)
    place, velocity = np.array([3.0, -3.0, 1.0]), np.array([-2.5, 4.0, -1.5]) / step_s
    # The place fades without a velocity of its own.
    fading = np.outer(place, 1 + time_s / _BEGINS_S) + np.outer(velocity, time_s)
    return fading * np.exp(-time_s / _BEGINS_S)


def _at_steps(
    local: Float[np.ndarray, "S A H 2"], step_s: float, axis: TimeAxis
) -> Float[np.ndarray, "S A F_plus_1 2"]:
    """Interpolate or extrapolate points to the steps of a time axis."""
    place = np.arange(axis.num_future_steps + 1) * (axis.step_s / step_s)
    before = np.minimum(place.astype(int), local.shape[-2] - 2)
    fraction = (place - before)[:, None]
    return local[..., before, :] * (1 - fraction) + local[..., before + 1, :] * fraction


def _empty(num_steps: int) -> dict[str, list[float] | list[list[float]]]:
    return {
        "step_s": [0.1],
        "mean_m": [0.0] * num_steps,
        "along": [[0.0] * num_steps] * NUM_ALONG,
        "across": [[0.0] * num_steps] * NUM_ACROSS,
        "scale_m": [1.0] * LATENT_SIZE,
    }
