"""Checkpoint of a training run, from which it is resumed exactly."""

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from pd_editor.base.errors import ModelError
from pd_editor.generation.checkpoints.tensor_file import (
    load_into,
    read_tensors,
    write_tensors,
)

_KIND: Final = "training-state"
_MODEL, _AVERAGE, _OPTIMISER = "model/", "average/", "optimiser/"


@dataclass(frozen=True, kw_only=True)
class TrainState:
    """Progress of a run."""

    step: int = 0
    """Number of finished steps."""
    trained_s: float = 0.0
    """Time spent on these steps."""


def write_state(
    path: Path,
    train_state: TrainState,
    *,
    model: nn.Module,
    average: nn.Module,
    optimiser: Optimizer,
) -> None:
    """Write a checkpoint.

    Random numbers are functions of the seed and the step, so no generator is stored.

    Raises:
        ModelError: the file cannot be written.
    """
    tensors = {_MODEL + name: one for name, one in model.state_dict().items()}
    tensors |= {_AVERAGE + name: one for name, one in average.state_dict().items()}
    for index, parameter in enumerate(_parameters(optimiser)):
        for name, value in optimiser.state.get(parameter, {}).items():
            tensors[f"{_OPTIMISER}{index}/{name}"] = torch.as_tensor(value)
    about = {"step": train_state.step, "trained_s": train_state.trained_s}
    write_tensors(path, _KIND, tensors, about)


def read_state(
    path: Path,
    *,
    model: nn.Module,
    average: nn.Module,
    optimiser: Optimizer,
    optional: Set[str] = frozenset(),
) -> TrainState:
    """Restore a run from a checkpoint, in which ``optional`` tensors may be missing.

    Raises:
        ModelError: the file is missing, damaged, or of another network.
    """
    file = read_tensors(path, _KIND)
    load_into(model, _below(file.tensors, _MODEL), path, optional)
    load_into(average, _below(file.tensors, _AVERAGE), path, optional)
    kept = _below(file.tensors, _OPTIMISER)
    for index, parameter in enumerate(_parameters(optimiser)):
        state = {}
        for name, value in _below(kept, f"{index}/").items():
            if value.dim() and value.shape != parameter.shape:
                raise ModelError(
                    f"{path}: the optimiser's {name} has the shape "
                    f"{tuple(value.shape)}; expected {tuple(parameter.shape)}."
                )
            state[name] = value.to(parameter.device)
        if state:
            optimiser.state[parameter] = state
    about = file.about
    return TrainState(step=int(about["step"]), trained_s=float(about["trained_s"]))


def _below(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {
        name.removeprefix(prefix): one
        for name, one in tensors.items()
        if name.startswith(prefix)
    }


def _parameters(optimiser: Optimizer) -> Iterator[nn.Parameter]:
    for group in optimiser.param_groups:
        yield from group["params"]
