"""Training objective of each stage: network, its first weights, loss and statistics."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import torch
from torch import Tensor, nn

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.config.run_config import OwnSamplesConfig
from pd_editor.experiments.training.config.settings import LOSSES, with_settings
from pd_editor.experiments.training.loop.run_folder import MODEL_NAME
from pd_editor.experiments.training.loop.train_loop import Loss
from pd_editor.experiments.training.sample_losses import (
    initial_state_samples_loss,
    trajectory_samples_loss,
)
from pd_editor.generation.checkpoints.model_folder import (
    StageKind,
    TrainedModel,
    load_model,
    made_model,
)
from pd_editor.generation.checkpoints.tensor_file import config_from_json
from pd_editor.generation.features.encoded_scene import PackedScene
from pd_editor.generation.features.feature_store import FeatureStore
from pd_editor.generation.initial_state.loss import initial_state_loss
from pd_editor.generation.initial_state.network.agent_count_prior import (
    MOST_ROWS,
    fit_agent_counts,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.noisy_traffic import fit_moments
from pd_editor.generation.initial_state.prediction_error import measured_clean_variance
from pd_editor.generation.inputs.scene_batch import SceneTensors
from pd_editor.generation.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.generation.stages import INITIAL_STATES, STAGE_KINDS, TRAJECTORIES
from pd_editor.generation.trajectory.loss import TrajectoryLossConfig, trajectory_loss
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser

_MOST_MEASURED: Final = 64
"""Number of scenes on which errors are measured."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the model: network, loss and statistics."""

    kind: StageKind
    loss_type: type[Any]
    """Flat dataclass of the loss settings, the last argument of the loss."""
    configured_loss: Callable[
        [Any, Any, torch.Generator, float, Any],
        tuple[torch.Tensor, Mapping[str, torch.Tensor]],
    ]
    samples_loss: Callable[
        [Any, Any, torch.Generator, OwnSamplesConfig],
        tuple[torch.Tensor, Mapping[str, torch.Tensor]],
    ]
    with_basis: Callable[[Any, TrajectoryBasis], nn.Module]
    """Makes a new network for latents of a basis."""

    fit_statistics: Callable[[nn.Module, FeatureStore], None] = lambda _model, _store: (
        None
    )
    """Stores statistics of the data in the network."""
    measure: Callable[[nn.Module, FeatureStore], None] = lambda _model, _store: None
    """Stores in a trained network what its sampler needs to know of the data and of the
    network's errors."""

    def loss(
        self, settings: Mapping[str, Any], own_samples: Mapping[str, Any] | None = None
    ) -> Loss:
        """Loss with some settings; the others have their defaults.

        With a weight of the network's own samples, their loss is added.

        Raises:
            ModelError: a setting is unknown or invalid.
        """
        usual = asdict(self.loss_type())
        config = config_from_json(self.loss_type, usual | dict(settings), "loss")
        samples = with_settings(OwnSamplesConfig(), own_samples or {}, "own_samples")

        def loss(
            model: Any, batch: Any, random: torch.Generator, progress: float
        ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
            found, parts = self.configured_loss(model, batch, random, progress, config)
            if not samples.weight:
                return found, parts
            added, further = self.samples_loss(model, batch, random, samples)
            return found + samples.weight * added, {
                **parts,
                **{f"own_{name}": part for name, part in further.items()},
            }

        return loss

    def fresh_model(self, config: Any, basis: TrajectoryBasis, seed: int) -> nn.Module:
        """Randomly initialised network; the seed determines its weights."""
        kind = replace(
            self.kind, make_model=lambda given: self.with_basis(given, basis)
        )
        return made_model(kind, config, seed=seed)


def _count_agents(model: nn.Module, store: FeatureStore) -> None:
    assert isinstance(model, InitialStateDenoiser)
    model.set_agent_counts(fit_agent_counts(_some(store, MOST_ROWS)))


def _measure(model: nn.Module, store: FeatureStore) -> None:
    assert isinstance(model, InitialStateDenoiser)
    moments = fit_moments(model, _some(store, MOST_ROWS))
    model.get_buffer("state_moments").copy_(moments)
    variance = measured_clean_variance(model, _some(store, _MOST_MEASURED))
    model.get_buffer("clean_variance").copy_(variance)


def _some(store: FeatureStore, most: int) -> Iterator[PackedScene]:
    """At most so many scenes, from everywhere in a store."""
    step = max(-(-len(store) // most), 1)
    return (store[index] for index in range(0, len(store), step))


def _trajectory_loss(
    model: nn.Module,
    batch: SceneTensors,
    random: torch.Generator,
    _progress: float,
    config: TrajectoryLossConfig,
) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
    assert isinstance(model, TrajectoryDenoiser)
    return trajectory_loss(model, batch, random, config)


STAGES: Final[Mapping[str, Stage]] = {
    "init": Stage(
        kind=INITIAL_STATES,
        loss_type=LOSSES["init"],
        configured_loss=initial_state_loss,
        samples_loss=initial_state_samples_loss,
        with_basis=lambda config, _: INITIAL_STATES.make_model(config),
        fit_statistics=_count_agents,
        measure=_measure,
    ),
    "traj": Stage(
        kind=TRAJECTORIES,
        loss_type=LOSSES["traj"],
        configured_loss=_trajectory_loss,
        samples_loss=trajectory_samples_loss,
        with_basis=TrajectoryDenoiser,
    ),
}


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
