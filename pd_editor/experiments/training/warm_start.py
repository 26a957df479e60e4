"""Initialisation of a run with the weights of an earlier model."""

import os
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.loop.run_folder import MODEL_NAME
from pd_editor.generation.checkpoints.model_folder import TrainedModel, load_model
from pd_editor.generation.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.generation.stages import STAGE_KINDS, TRAJECTORIES
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser


def starting_model(folder: Path) -> TrainedModel:
    """Load the model of a folder, which may be that of a run.

    Raises:
        ModelError: the folder holds no model.
    """
    inner = folder / MODEL_NAME
    return load_model(inner if os.path.isdir(inner) else folder, STAGE_KINDS)


def basis_of(model: TrainedModel) -> TrajectoryBasis | None:
    """Trajectory basis of a model; None without the trajectory stage."""
    stage = model.stages.get(TRAJECTORIES.name)
    if stage is None:
        return None
    assert isinstance(stage.model, TrajectoryDenoiser)
    return stage.model.decoder.basis


def start_from(model: nn.Module, earlier: Mapping[str, Tensor], source: object) -> None:
    """Initialise a network with the weights of an earlier, possibly smaller one.

    Tensors of the same name and shape are copied. Of larger tensors, the earlier part is
    copied; new columns (inputs) are zero, so that they have no effect at first; new rows
    (outputs) keep their random initialisation.

    Raises:
        TrainingError: a tensor is smaller than before, or has other axes.
    """
    own = model.state_dict()
    with torch.no_grad():
        for name, old in earlier.items():
            new = own.get(name)
            if new is None:
                continue
            grown = new.ndim == old.ndim and all(
                mine >= theirs
                for mine, theirs in zip(new.shape, old.shape, strict=False)
            )
            if not grown:
                raise TrainingError(
                    f"{source}: {name} is of shape {tuple(old.shape)}, and this network "
                    f"has {tuple(new.shape)}; a run can start from smaller networks only."
                )
            if new.ndim == 2:
                new[: old.shape[0], old.shape[1] :] = 0
            new[tuple(slice(size) for size in old.shape)] = old.to(new)
