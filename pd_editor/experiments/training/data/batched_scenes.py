"""Batches of scenes for the training loop, and their augmentation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Int

from pd_editor.generation.inputs.scene_batch import SceneTensors


@runtime_checkable
class Batch(Protocol):
    """Interface of batches of scenes."""

    def to(self, device: torch.device, /) -> "Batch":
        """Move the batch to a device."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingData:
    """N scenes: training and validation rows, and functions that batch them."""

    training_rows: tuple[Int[np.ndarray, "_"], ...]
    held_out_rows: Int[np.ndarray, "_"]
    size: Int[np.ndarray, "N"]
    """Size of each scene; scenes of similar size share batches."""
    batch: Callable[[Int[np.ndarray, "_"]], Batch]
    augment: Callable[[Any, torch.Generator], Batch]
    """Augments a batch by symmetries of the data."""


def augmented_scenes(scene: SceneTensors, random: torch.Generator) -> SceneTensors:
    """Rotate scenes at random, and mirror half of them."""
    turn = torch.rand(scene.num_scenes, generator=random) * 2 * torch.pi
    if torch.rand((), generator=random) < 0.5:
        scene = scene.mirrored()
    return scene.rotated(turn.to(scene.agent_pose, non_blocking=True))
