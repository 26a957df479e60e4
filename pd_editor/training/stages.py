"""How each stage is trained: its network on the data's basis, and its loss."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import torch
from torch import nn

from pd_editor.diffusion.model_folder import StageKind, made_model
from pd_editor.diffusion.pose_loss import pose_loss
from pd_editor.diffusion.scene_tensors import SceneTensors
from pd_editor.diffusion.stages import INITIAL_STATES, TRAJECTORIES
from pd_editor.diffusion.trajectory_basis import TrajectoryBasis
from pd_editor.diffusion.trajectory_denoiser import TrajectoryDenoiser
from pd_editor.diffusion.trajectory_loss import trajectory_loss
from pd_editor.training.train_loop import Loss


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One of the model's stages, as it is trained."""

    kind: StageKind
    loss: Loss
    with_basis: Callable[[Any, TrajectoryBasis], nn.Module]
    """A fresh network for latents of a basis."""

    def fresh_model(self, config: Any, basis: TrajectoryBasis, seed: int) -> nn.Module:
        """The network before training; the seed decides its weights."""
        kind = StageKind(
            name=self.kind.name,
            file_name=self.kind.file_name,
            config_type=self.kind.config_type,
            make_model=lambda given: self.with_basis(given, basis),
        )
        return made_model(kind, config, seed=seed)


STAGES: Final[Mapping[str, Stage]] = {
    "init": Stage(
        kind=INITIAL_STATES,
        loss=pose_loss,
        with_basis=lambda config, _: INITIAL_STATES.make_model(config),
    ),
    "traj": Stage(
        kind=TRAJECTORIES,
        loss=trajectory_loss,
        with_basis=TrajectoryDenoiser,
    ),
}


def augmented_scenes(scene: SceneTensors, random: torch.Generator) -> SceneTensors:
    """Scenes turned at random, and mirrored half of the time."""
    turn = torch.rand(scene.num_scenes, generator=random) * 2 * torch.pi
    if torch.rand((), generator=random) < 0.5:
        scene = scene.mirrored()
    return scene.rotated(turn.to(scene.agent_pose))
