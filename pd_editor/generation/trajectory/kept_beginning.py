"""Locked beginnings of sampled trajectories: conditioning and seamless continuation.

Positions are linear in an agent's latents, so a known beginning is a linear system. Each
predicted clean sample is moved to the nearest latents that solve it (inpainting in the
latent basis); the basis does not represent a recorded beginning exactly, so the decoded
rest is joined to it by a decaying offset without a jump of position or velocity.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.inputs.trajectory_pca import TrajectoryBasis, heading_along
from pd_editor.generation.trajectory.network.decoding import Motion
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.scenario import Scenario

_POSITION_NOISE_M: Final = 0.6
"""Tolerance of each kept position, against latents of unit variance: recorded positions
jitter, and a rest that follows from the jitter is not drivable."""
_VELOCITY_NOISE_MPS: Final = 0.5
"""Tolerance of the velocity at the end of the kept beginning."""
_BLEND_S: Final = 2.0
"""Time in which the offset of the rest decays."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptBeginning:
    """Kept states of K sampled agents at the current step and F later ones."""

    index: Int[np.ndarray, "K"]
    is_kept: Bool[np.ndarray, "K F_plus_1"]
    """Steps at which an agent exists and its state is kept."""
    last: Int[np.ndarray, "K"]
    """Last kept step, at least 1."""
    position_m: Float[np.ndarray, "K F_plus_1 2"]
    heading_rad: Float[np.ndarray, "K F_plus_1"]
    velocity_mps: Float[np.ndarray, "K F_plus_1 2"]
    step_s: float

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        agent_row: Int[np.ndarray, "A"],
        is_sampled: Bool[np.ndarray, "A"],
    ) -> "KeptBeginning":
        """Kept beginnings of the sampled agents with such a lock.

        ``agent_row`` are the rows of the task's agents in the scenario.
        """
        now, agents = scenario.current_step, scenario.agents
        is_kept = (scenario.kept_steps() & agents.is_valid)[agent_row, now:]
        index = np.flatnonzero(is_sampled & (is_kept.sum(axis=1) > 1))
        rows, is_kept = agent_row[index], is_kept[index]
        last = is_kept.shape[1] - 1 - is_kept[:, ::-1].argmax(axis=1)
        return cls(
            index=index,
            is_kept=is_kept,
            last=last,
            position_m=agents.position_m[rows, now:],
            heading_rad=agents.heading_rad[rows, now:],
            velocity_mps=agents.velocity_mps[rows, now:],
            step_s=scenario.time_axis.step_s,
        )

    def __len__(self) -> int:
        return len(self.index)

    def projection(
        self, basis: TrajectoryBasis, num_agents: int
    ) -> tuple[Float[np.ndarray, "A 10 10"], Float[np.ndarray, "A 10"]]:
        """Matrix and offset that move latents of each agent to those that are kept.

        The result is the most probable latents under the prediction with unit variance
        and the kept states; other agents have the identity.
        """
        size = len(basis.scale_m)
        matrix = np.tile(np.eye(size), (num_agents, 1, 1))
        offset = np.zeros((num_agents, size))
        if abs(self.step_s - basis.step_s) > 1e-6:
            return matrix, offset
        for place, agent in enumerate(self.index):
            rows, target = self._system(basis, place)
            gain = np.linalg.solve(rows.T @ rows + np.eye(size), rows.T)
            matrix[agent] -= gain @ rows
            offset[agent] = gain @ target
        return matrix, offset

    def _system(
        self, basis: TrajectoryBasis, place: int
    ) -> tuple[Float[np.ndarray, "R 10"], Float[np.ndarray, "R"]]:
        """Rows and targets of one agent in units of their tolerances."""
        size = len(basis.scale_m)
        first = self.position_m[place, 0]
        turn = np.exp(-1j * self.heading_rad[place, 0])
        speed = np.full(size + 1, np.hypot(*self.velocity_mps[place, 0]))
        units = basis.decode(np.concatenate([np.zeros((1, size)), np.eye(size)]), speed)
        mean, shape = units[0], units[1:] - units[0]
        steps = np.flatnonzero(self.is_kept[place, 1 : basis.num_steps + 1])
        gap = self.position_m[place, steps + 1] - first
        local = (gap[:, 0] + 1j * gap[:, 1]) * turn
        points = np.stack([local.real, local.imag], axis=-1) - mean[steps]
        rows = [shape[:, steps].reshape(size, -1).T / _POSITION_NOISE_M]
        targets = [points.reshape(-1) / _POSITION_NOISE_M]
        end = int(self.last[place]) - 1
        if 1 <= end < basis.num_steps - 1:
            velocity = self.velocity_mps[place, end + 1]
            local = (velocity[0] + 1j * velocity[1]) * turn
            wanted = np.array([local.real, local.imag])
            unit = 1 / (2 * basis.step_s * _VELOCITY_NOISE_MPS)
            rows.append((shape[:, end + 1] - shape[:, end - 1]).T * unit)
            targets.append(
                wanted / _VELOCITY_NOISE_MPS - (mean[end + 1] - mean[end - 1]) * unit
            )
        return np.concatenate(rows), np.concatenate(targets)

    def joined(self, motion: Motion) -> Motion:
        """Motion of all agents in which kept states are exact and the rest continues them."""
        if not len(self):
            return motion
        position = motion.position_m.copy()
        heading = motion.heading_rad.copy()
        velocity = motion.velocity_mps.copy()
        num_steps = position.shape[2]
        for place, agent in enumerate(self.index):
            last, kept = int(self.last[place]), self.is_kept[place]
            rest = slice(last, num_steps)
            own = position[:, agent]
            decoded = own[:, rest].copy()
            if len(decoded[0]) > 1:
                slope = (decoded[:, 1] - own[:, last - 1]) / (2 * self.step_s)
                offset = self.position_m[place, last] - decoded[:, 0]
                drift = self.velocity_mps[place, last] - slope
                decoded = decoded + self._decaying(offset, drift, num_steps - last)
            own[:, rest] = decoded
            own[:, kept] = self.position_m[place, kept]
            heading[:, agent, rest] = self._headings(place, own[:, rest])
            heading[:, agent, kept] = self.heading_rad[place, kept]
            velocity[:, agent, 1:] = np.gradient(own, self.step_s, axis=1)[:, 1:]
            velocity[:, agent, kept] = self.velocity_mps[place, kept]
        return Motion(position_m=position, heading_rad=heading, velocity_mps=velocity)

    def _decaying(
        self,
        offset_m: Float[np.ndarray, "S 2"],
        drift_mps: Float[np.ndarray, "S 2"],
        num_steps: int,
    ) -> Float[np.ndarray, "S N 2"]:
        """Offset at the steps after the beginning: a cubic that ends at rest at zero."""
        share = np.minimum(np.arange(num_steps) * self.step_s / _BLEND_S, 1.0)[:, None]
        stays = (1 + 2 * share) * (1 - share) ** 2
        rises = share * (1 - share) ** 2 * _BLEND_S
        return stays * offset_m[:, None] + rises * drift_mps[:, None]

    def _headings(
        self, place: int, path_m: Float[np.ndarray, "S N 2"]
    ) -> Float[np.ndarray, "S N"]:
        """Headings along the rest of the path, turned smoothly from the kept one."""
        first = np.full(len(path_m), self.heading_rad[place, self.last[place]])
        course = heading_along(path_m, first)
        if course.shape[1] < 2:
            return course
        turn = wrap_angle(first - course[:, 1])
        after_s = np.maximum(np.arange(course.shape[1]) - 1, 0) * self.step_s
        # In a second the heading turns from the kept one to that of the path.
        share = np.maximum(1 - after_s, 0.0)
        return wrap_angle(course + share * turn[:, None])


def projected(
    latent: Float[Tensor, "S B A 10"],
    matrix: Float[Tensor, "B A 10 10"],
    offset: Float[Tensor, "B A 10"],
) -> Float[Tensor, "S B A 10"]:
    """Latents moved to those of the kept beginnings."""
    return torch.einsum("baij,sbaj->sbai", matrix, latent) + offset
