"""Trajectories as ten latents: principal components of the constant-velocity residual."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.base.errors import ModelError
from pd_editor.generation.features.scene_features import LATENT_SIZE
from pd_editor.scene.geometry.angles import wrap_angle

NUM_ALONG: Final = 5
NUM_ACROSS: Final = LATENT_SIZE - NUM_ALONG
MIRRORED_LATENT_SIGNS: Final = (1.0,) * NUM_ALONG + (-1.0,) * NUM_ACROSS
"""Signs of the latents of a mirrored trajectory."""

_CHORD_STEPS: Final = 2
_TURNS_FROM_M: Final = 0.25
"""Least length of a chord that defines a heading."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryBasis:
    """Basis that maps H future points, in the agent's frame, to D latents.

    The residual to constant velocity straight ahead is projected on orthonormal
    components and divided by their standard deviations. Each component is along the
    heading or across it, so that mirroring a trajectory flips signs. The current point
    is not encoded, so it is exact.
    """

    step_s: float
    mean_m: Float[np.ndarray, "H"]
    """Mean residual along the heading; across it is zero by symmetry."""
    along: Float[np.ndarray, "5 H"]
    across: Float[np.ndarray, "5 H"]
    scale_m: Float[np.ndarray, "10"]
    """Standard deviation of each component, as the norm of H distances."""

    @classmethod
    def fit(
        cls,
        future_m: Float[np.ndarray, "N H 2"],
        speed_mps: Float[np.ndarray, "N"],
        step_s: float = 0.1,
    ) -> "TrajectoryBasis":
        """Fit the principal components of trajectories and of their mirror images."""
        residual = future_m - _straight_on(speed_mps, future_m.shape[1], step_s)
        mean = residual[..., 0].mean(0)
        count = max(len(residual), 1)
        along, along_scale = _components(residual[..., 0] - mean, NUM_ALONG, count)
        across, across_scale = _components(residual[..., 1], NUM_ACROSS, count)
        scale = np.concatenate([along_scale, across_scale])
        return cls(
            step_s=step_s,
            mean_m=mean,
            along=along,
            across=across,
            scale_m=np.maximum(scale, 0.05),
        )

    @property
    def num_steps(self) -> int:
        """Number of future points."""
        return len(self.mean_m)

    def encode(
        self, future_m: Float[np.ndarray, "*shape H 2"], speed_mps: np.ndarray
    ) -> Float[np.ndarray, "*shape 10"]:
        """Encode trajectories as latents; speeds are broadcast against leading axes.

        Points after the last step of the basis are ignored.
        """
        future_m = future_m[..., : self.num_steps, :]
        time = self.step_s * np.arange(1, self.num_steps + 1)
        offset = self.mean_m @ self.along.T
        pace = time @ self.along.T
        along = future_m[..., 0] @ self.along.T - offset
        along -= np.asarray(speed_mps)[..., None] * pace
        across = future_m[..., 1] @ self.across.T
        return np.concatenate([along, across], axis=-1) / self.scale_m

    def decode(
        self, latent: Float[np.ndarray, "*shape 10"], speed_mps: np.ndarray
    ) -> Float[np.ndarray, "*shape H 2"]:
        """Decode latents to trajectories; speeds are broadcast against leading axes."""
        scaled = latent * self.scale_m
        residual = np.stack(
            [
                scaled[..., :NUM_ALONG] @ self.along + self.mean_m,
                scaled[..., NUM_ALONG:] @ self.across,
            ],
            axis=-1,
        )
        return residual + _straight_on(speed_mps, self.num_steps, self.step_s)

    def completed(
        self,
        future_m: Float[np.ndarray, "N H 2"],
        is_valid: Bool[np.ndarray, "N H"],
        speed_mps: Float[np.ndarray, "N"],
    ) -> Float[np.ndarray, "N 10"]:
        """Most probable latents of partly known trajectories, under N(0, I) and 0.1 m."""
        noise_m = 0.1
        mean = self.decode(np.zeros((len(future_m), LATENT_SIZE)), speed_mps)
        known = is_valid.astype(float)[..., None]
        gap = np.where(known > 0, future_m - mean, 0.0)
        latent = np.empty((len(future_m), LATENT_SIZE))
        for axis, (basis, part) in enumerate(
            [
                (self.along, slice(None, NUM_ALONG)),
                (self.across, slice(NUM_ALONG, None)),
            ]
        ):
            matrix = self.scale_m[part, None] * basis
            normal = np.einsum("ih,nh,jh->nij", matrix, known[..., 0], matrix)
            normal += noise_m**2 * np.eye(len(matrix))
            right = gap[..., axis] @ matrix.T
            latent[:, part] = np.linalg.solve(normal, right[..., None])[..., 0]
        return latent

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays to store, by name; ``of_arrays`` is the inverse."""
        return {
            "step_s": np.array([self.step_s]),
            "mean_m": self.mean_m,
            "along": self.along,
            "across": self.across,
            "scale_m": self.scale_m,
        }

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray]) -> "TrajectoryBasis":
        """Make the basis from its arrays.

        Raises:
            ModelError: its steps take no time, as in a damaged file.
        """
        step_s = float(arrays["step_s"][0])
        if not step_s > 0:
            raise ModelError(
                f"The basis of the trajectories has steps of {step_s:g} s; expected more "
                "than 0. Its weights are damaged."
            )
        return cls(
            step_s=step_s,
            mean_m=np.asarray(arrays["mean_m"], float),
            along=np.asarray(arrays["along"], float),
            across=np.asarray(arrays["across"], float),
            scale_m=np.asarray(arrays["scale_m"], float),
        )


def heading_along(
    position_m: Float[np.ndarray, "*shape S 2"],
    first_rad: Float[np.ndarray, "*shape"],
) -> Float[np.ndarray, "*shape S"]:
    """Headings of agents along their paths, constant while they are stationary.

    The first one is given. On a path that starts backwards, headings oppose the motion.
    """
    steps = position_m.shape[-2]
    early = np.maximum(np.arange(steps) - _CHORD_STEPS, 0)
    late = np.minimum(np.arange(steps) + _CHORD_STEPS, steps - 1)
    chord = position_m[..., late, :] - position_m[..., early, :]
    course = np.arctan2(chord[..., 1], chord[..., 0])
    tells = np.hypot(chord[..., 0], chord[..., 1]) > _TURNS_FROM_M
    tells[..., 0] = True
    course[..., 0] = first_rad
    backs = np.abs(wrap_angle(course - first_rad[..., None])) > np.pi / 2
    moved = position_m[..., -1, :] - position_m[..., 0, :]
    reverses = np.hypot(moved[..., 0], moved[..., 1]) < 5.0
    course = np.where(backs & reverses[..., None], course + np.pi, course)
    last = np.maximum.accumulate(np.where(tells, np.arange(steps), 0), axis=-1)
    held = wrap_angle(np.take_along_axis(course, last, axis=-1))
    # The given heading is preserved exactly.
    return np.where(last == 0, first_rad[..., None], held)


def _straight_on(
    speed_mps: np.ndarray, num_steps: int, step_s: float
) -> Float[np.ndarray, "*shape H 2"]:
    time = step_s * np.arange(1, num_steps + 1)
    distance = np.asarray(speed_mps)[..., None] * time
    return np.stack([distance, np.zeros_like(distance)], axis=-1)


def _components(
    residual: Float[np.ndarray, "N H"], count: int, num_samples: int
) -> tuple[Float[np.ndarray, "K H"], Float[np.ndarray, "K"]]:
    values, vectors = np.linalg.eigh(residual.T @ residual / num_samples)
    order = np.argsort(values)[::-1][:count]
    components = vectors[:, order].T
    # eigh does not determine signs: the end of each component is made positive.
    components *= np.where(components[:, -1:] < 0, -1.0, 1.0)
    return components, np.sqrt(np.maximum(values[order], 0.0))
