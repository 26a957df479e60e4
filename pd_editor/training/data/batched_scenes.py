"""Scenes in batches: what the training loop reads, and their augmentation per step."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Int

from pd_editor.diffusion.inputs.scene_batch import SceneTensors


@runtime_checkable
class Batch(Protocol):
    """Scenes as tensors."""

    def to(self, device: torch.device, /) -> "Batch":
        """On another device."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingData:
    """N scenes, by row: what is trained on, what is held out, how they are batched."""

    training_rows: tuple[Int[np.ndarray, "_"], ...]
    """Of each data root."""
    held_out_rows: Int[np.ndarray, "_"]
    size: Int[np.ndarray, "N"]
    """How much work a scene is; scenes of like size share batches."""
    batch: Callable[[Int[np.ndarray, "_"]], Batch]
    augment: Callable[[Any, torch.Generator], Batch]
    """Another scene that is as likely as the one it is given."""


def augmented_scenes(scene: SceneTensors, random: torch.Generator) -> SceneTensors:
    """Scenes turned at random, and mirrored half of the time."""
    turn = torch.rand(scene.num_scenes, generator=random) * 2 * torch.pi
    if torch.rand((), generator=random) < 0.5:
        scene = scene.mirrored()
    return scene.rotated(turn.to(scene.agent_pose))
