"""A denoiser of one's own: all trajectories keep their velocity.

pd-editor generate signalised-junction --model examples.own_denoiser:generator --out out
"""

import torch
from torch import Tensor, nn

from pd_editor.base.installed_files import models_folder
from pd_editor.generation.core.sampler import Denoise
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser


class ConstantVelocity(nn.Module):
    """Predicts the same latents at all noise levels."""

    def __init__(self, shipped: TrajectoryDenoiser) -> None:
        """Take the basis of latents and the schedule of a trained network."""
        super().__init__()
        self.config, self.schedule = shipped.config, shipped.schedule
        self.decoder = shipped.decoder

    def encode_context(self, scene: SceneTensors) -> Tensor:
        """Latents [B A 10] of no difference from constant velocity."""
        return self.decoder.still(torch.zeros_like(scene.agent_speed))

    def at_levels(self, levels: Tensor, context: Tensor) -> Denoise:
        """Predict them, whatever the noise."""
        return lambda noisy, step: context.expand_as(noisy)


def generator() -> PathDiffuser:
    """Make the shipped model with this denoiser of trajectories."""
    folder = models_folder() / "path-diffuser"
    shipped = PathDiffuser(folder).model().stage("traj").model
    assert isinstance(shipped, TrajectoryDenoiser)
    return PathDiffuser(folder, trajectory_model=ConstantVelocity(shipped))
