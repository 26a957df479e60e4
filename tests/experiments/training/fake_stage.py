"""A tiny network with noise in its loss, trained on random numbers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn

from pd_editor.experiments.training.run_config import (
    Budget,
    Optimisation,
    RunConfig,
)
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.train_loop import TrainLoop
from pd_editor.experiments.training.training_data import TrainingData


@dataclass(frozen=True)
class Numbers:
    values: Tensor

    def to(self, device: torch.device) -> "Numbers":
        return Numbers(self.values.to(device))


def fresh_model() -> nn.Module:
    with torch.random.fork_rng():
        torch.manual_seed(7)
        return nn.Sequential(nn.Linear(4, 8), nn.GELU(), nn.Linear(8, 4))


def noisy_loss(
    model: nn.Module, batch: Numbers, random: torch.Generator, progress: float
) -> tuple[Tensor, dict[str, Tensor]]:
    noise = torch.randn(batch.values.shape, generator=random)
    error = (model(batch.values + noise) - batch.values).square().mean()
    return error, {"error": error.detach()}


def number_data(num: int = 120, num_held_out: int = 20) -> TrainingData:
    table = torch.from_numpy(
        np.random.default_rng(1).standard_normal((num, 4)).astype(np.float32)
    )
    rows = np.arange(num)
    return TrainingData(
        training_rows=(rows[num_held_out : num // 2], rows[num // 2 :]),
        held_out_rows=rows[:num_held_out],
        size=rows % 7,
        batch=lambda chosen: Numbers(table[torch.from_numpy(chosen)]),
        augment=lambda batch, random: Numbers(
            batch.values * (1 + 0.1 * torch.rand((), generator=random))
        ),
    )


def config_of(steps: int, **optimisation: float) -> RunConfig:
    return RunConfig(
        stage="traj",
        data=("a", "b"),
        model={},
        optimisation=Optimisation(
            **{"batch_size": 8, "warmup_steps": 5, **optimisation}
        ),
        budget=Budget(steps=steps),
    )


def loop_of(
    folder: Path,
    steps: int = 60,
    *,
    config: RunConfig | None = None,
    loss=noisy_loss,
    data: TrainingData | None = None,
) -> TrainLoop:
    folder.mkdir(parents=True, exist_ok=True)
    return TrainLoop(
        config_of(steps) if config is None else config,
        fresh_model(),
        loss,
        number_data() if data is None else data,
        RunFolder(folder),
        Fabric(accelerator="cpu", devices=1),
    )
