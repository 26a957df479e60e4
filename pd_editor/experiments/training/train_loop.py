"""Training loop of both stages, on a CPU or on one or several GPUs."""

import contextlib
import copy
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.optim import Optimizer
from torch.optim.swa_utils import get_ema_multi_avg_fn

from pd_editor.base.errors import ModelError, TrainingError
from pd_editor.experiments.training.run_config import (
    Budget,
    Optimisation,
    RunConfig,
)
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.training_data import (
    Batch,
    BatchSampler,
    TrainingData,
)
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


_STEPS_PER_LINE = 25
_BETAS = (0.9, 0.99)
"""Betas of AdamW; the second is below the usual 0.999, since runs are short."""
_AUGMENT, _NOISE, _HELD_OUT = 1, 2, 3


Loss = Callable[[Any, Any, torch.Generator, float], tuple[Tensor, Mapping[str, Tensor]]]
"""Loss of a network on a batch, and its parts by name. The third argument is a generator
on the CPU, the fourth the fraction of the training that is done."""
_Item = TypeVar("_Item")


@dataclass(frozen=True, kw_only=True)
class TrainingProgress:
    """Progress of a run with its losses."""

    train_state: TrainState
    fraction: float
    """Fraction of the budget that is spent."""
    loss: float
    """Mean loss of the last steps."""
    held_out_loss: float
    """Loss at the last validation; NaN before the first one."""
    scenes_per_s: float
    left_s: float


class _WrappedBatch:
    """Input of a step, wrapped so that Fabric does not convert it."""

    def __init__(self, batch: Batch, random: torch.Generator, progress: float) -> None:
        self.batch, self.random, self.progress = batch, random, progress


class _LossModule(nn.Module):
    """Network with its loss as one forward pass, which data parallelism requires."""

    def __init__(self, model: nn.Module, loss: Loss) -> None:
        super().__init__()
        self.model, self._loss = model, loss

    def forward(self, work: _WrappedBatch) -> tuple[Tensor, dict[str, Tensor]]:
        loss, parts = self._loss(self.model, work.batch, work.random, work.progress)
        return loss, {name: part.detach() for name, part in parts.items()}


class TrainLoop:
    """A run in progress: network, average, optimiser and state."""

    def __init__(
        self,
        config: RunConfig,
        model: nn.Module,
        loss: Loss,
        data: TrainingData,
        folder: RunFolder,
        fabric: Fabric,
    ) -> None:
        self._config, self._loss, self._data = config, loss, data
        self._folder, self._fabric = folder, fabric
        self.train_state = TrainState()
        self._average = WeightAverage(model, config.optimisation.ema_decay)
        self._average.model.to(fabric.device)
        module = _LossModule(model, loss)
        optimiser = adamw(model, config.optimisation)
        self._module, self._optimiser = fabric.setup(module, optimiser)
        self._model = model
        shares = config.weights or [len(rows) for rows in data.training_rows]
        self._sampler = BatchSampler(
            data.training_rows,
            data.size,
            shares=shares,
            batch_size=config.optimisation.batch_size,
            seed=config.seed,
        )
        self.held_out_loss = math.nan
        """Loss of the averaged network at the last validation."""
        self._paused_s = 0.0
        """Time that callers took at checkpoints, which is no training."""

    @property
    def averaged_model(self) -> nn.Module:
        """The averaged network, which is the result of the run."""
        return self._average.model

    def resume(self, optional: Set[str] = frozenset()) -> None:
        """Resume from the folder's checkpoint, which may lack ``optional`` tensors.

        Raises:
            ModelError: the checkpoint is damaged or of another network.
        """
        self.train_state = read_state(
            self._folder.state_path,
            model=self._model,
            average=self._average.model,
            optimiser=self._optimiser.optimizer,
            optional=optional,
        )
        for entry in self._folder.logged():
            if entry.get("held_out") and entry["step"] <= self.train_state.step:
                self.held_out_loss = entry["loss"]
        if self._fabric.is_global_zero:
            self._folder.forget_after(self.train_state.step)

    def run(
        self,
        *,
        is_stopped: Callable[[], bool] = lambda: False,
        on_checkpoint: Callable[[], None] = lambda: None,
    ) -> Iterator[TrainingProgress]:
        """Train until the budget is spent or a stop is requested, yielding progress.

        A checkpoint is written every few minutes and at the end. If a caller stops
        iterating, steps after the last checkpoint are lost. ``is_stopped`` is called
        after each step, ``on_checkpoint`` after each checkpoint on the first process.

        Raises:
            TrainingError: the loss is not finite.
        """
        budget, recent = self._config.budget, RecentLosses()
        checked_s = self.train_state.trained_s
        began = time.perf_counter() - self.train_state.trained_s - self._paused_s
        is_over = spent(budget, self.train_state) >= 1
        with prefetched(self._batch, first=self.train_state.step) as batches:
            while not is_over:
                recent.add(*self._step(next(batches)))
                trained_s, must_stop = self._fabric.broadcast(
                    (time.perf_counter() - began - self._paused_s, is_stopped())
                )
                self.train_state = TrainState(
                    step=self.train_state.step + 1, trained_s=trained_s
                )
                is_over = must_stop or spent(budget, self.train_state) >= 1
                is_due = (
                    is_over or trained_s - checked_s > 60 * budget.checkpoint_minutes
                )
                if is_due or recent.count + recent.num_left_out >= _STEPS_PER_LINE:
                    yield self._reported(recent)
                    if is_due:
                        checked_s = trained_s
                        self._checkpoint(on_checkpoint, is_hasty=must_stop)
                    recent = RecentLosses()

    def _batch(self, step: int) -> Batch:
        """Part of a step's scenes for this process."""
        rows = self._sampler.rows(step)
        fabric = self._fabric
        return self._data.batch(rows[fabric.global_rank :: fabric.world_size])

    def _random(self, purpose: int, index: int) -> torch.Generator:
        """Random generator of a step, independent of earlier steps."""
        config, rank = self._config, self._fabric.global_rank
        state = np.random.SeedSequence([config.seed, purpose, index, rank])
        generator = torch.Generator()
        generator.manual_seed(int(state.generate_state(1, np.uint64)[0] >> 1))
        return generator

    def _step(self, batch: Batch) -> tuple[Tensor, Mapping[str, Tensor], float]:
        """Run one step; returns the loss, its parts, and the norm of the gradient."""
        step, optimisation = self.train_state.step, self._config.optimisation
        progress = spent(self._config.budget, self.train_state)
        rate = learning_rate(optimisation, step, progress)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        moved = batch.to(self._fabric.device)
        moved = self._data.augment(moved, self._random(_AUGMENT, step))
        loss, parts = self._module(
            _WrappedBatch(moved, self._random(_NOISE, step), progress)
        )
        self._fabric.backward(loss)
        norm = self._fabric.clip_gradients(
            self._module,
            self._optimiser,
            max_norm=optimisation.max_gradient_norm,
            error_if_nonfinite=False,
        )
        length = float(norm) if norm is not None else 0.0
        if math.isfinite(length):
            self._optimiser.step()
            self._average.update(self._model, step)
        self._optimiser.zero_grad()
        return loss.detach(), parts, length

    def _reported(self, recent: "RecentLosses") -> TrainingProgress:
        train_state, fabric = self.train_state, self._fabric
        entry = recent.entry(train_state)
        if fabric.is_global_zero:
            self._folder.log(entry)
        fraction = min(1.0, spent(self._config.budget, train_state))
        speed = recent.count * self._config.optimisation.batch_size / recent.seconds
        left = (1 - fraction) * train_state.trained_s / max(fraction, 1e-6)
        return TrainingProgress(
            train_state=train_state,
            fraction=fraction,
            loss=entry["loss"],
            held_out_loss=self.held_out_loss,
            scenes_per_s=speed,
            left_s=left,
        )

    def _checkpoint(self, on_checkpoint: Callable[[], None], *, is_hasty: bool) -> None:
        """Write a checkpoint; validate as well unless ``is_hasty``."""
        if not is_hasty and len(self._data.held_out_rows):
            entry = self._validated()
            self.held_out_loss = entry["loss"]
            if self._fabric.is_global_zero:
                self._folder.log(entry)
        if self._fabric.is_global_zero:
            write_state(
                self._folder.state_path,
                self.train_state,
                model=self._model,
                average=self._average.model,
                optimiser=self._optimiser.optimizer,
            )
            paused = time.perf_counter()
            on_checkpoint()
            self._paused_s += time.perf_counter() - paused
        self._fabric.barrier()

    @torch.no_grad()
    def _validated(self) -> dict[str, Any]:
        """Validate the averaged network on held-out scenes, always with equal noise."""
        rows, recent = self._data.held_out_rows, RecentLosses()
        rows = rows[np.argsort(self._data.size[rows], kind="stable")]
        size = self._config.optimisation.batch_size
        for index in range(-(-len(rows) // size)):
            batch = self._data.batch(rows[index * size : (index + 1) * size])
            with self._fabric.autocast():
                loss, parts = self._loss(
                    self._average.model,
                    batch.to(self._fabric.device),
                    self._random(_HELD_OUT, index),
                    1.0,
                )
            recent.add(loss, parts, 0.0)
        return recent.entry(self.train_state, held_out=True)


class RecentLosses:
    """Accumulated losses of the last steps, for the log."""

    def __init__(self) -> None:
        self.count = 0
        self.num_left_out = 0
        self._began = time.perf_counter()
        self._sums: dict[str, Tensor] = {}
        self._norm = 0.0

    @property
    def seconds(self) -> float:
        """Time since the first step."""
        return max(time.perf_counter() - self._began, 1e-9)

    def add(self, loss: Tensor, parts: Mapping[str, Tensor], norm: float) -> None:
        """Add a step; steps without a finite gradient are counted only."""
        if not math.isfinite(norm):
            self.num_left_out += 1
            return
        self.count += 1
        self._norm += norm
        for name, value in {"": loss, **parts}.items():
            earlier = self._sums.get(name, 0.0)
            self._sums[name] = earlier + value.detach().float()

    def entry(
        self, train_state: TrainState, *, held_out: bool = False
    ) -> dict[str, Any]:
        """Entry of the log: means over the steps.

        Raises:
            TrainingError: the loss is not finite.
        """
        means = {name: float(one) / self.count for name, one in self._sums.items()}
        loss = means.pop("", math.nan)
        if not math.isfinite(loss):
            raise TrainingError(
                f"The loss became {loss} around step {train_state.step}; begin again with "
                "a lower learning rate."
            )
        entry = {
            "step": train_state.step,
            "minutes": round(train_state.trained_s / 60, 4),
            "held_out": held_out,
            "loss": loss,
            "parts": means,
        }
        if not held_out:
            entry["gradient_norm"] = self._norm / self.count
            entry["steps_per_s"] = round(self.count / self.seconds, 3)
            entry["left_out"] = self.num_left_out
        return entry


def adamw(model: nn.Module, optimisation: Optimisation) -> torch.optim.AdamW:
    """AdamW with weight decay of matrices only."""
    matrices = [one for one in model.parameters() if one.dim() >= 2]
    others = [one for one in model.parameters() if one.dim() < 2]
    return torch.optim.AdamW(
        [
            {"params": matrices, "weight_decay": optimisation.weight_decay},
            {"params": others, "weight_decay": 0.0},
        ],
        lr=optimisation.learning_rate,
        betas=_BETAS,
        fused=True,
    )


def spent(budget: Budget, train_state: TrainState) -> float:
    """Fraction of the budget that is spent; 1 or more at the end."""
    if budget.steps is not None:
        return train_state.step / budget.steps
    return train_state.trained_s / (60 * budget.minutes)


def learning_rate(optimisation: Optimisation, step: int, fraction: float) -> float:
    """Learning rate: linear warm-up, plateau, then cosine decay to zero.

    The warm-up of a short run is over after a tenth of it.
    """
    constant = optimisation.constant_share
    warmed = (step + 1) / (optimisation.warmup_steps + 1)
    # Greatest share of a run in which the learning rate warms up.
    warmth = min(1.0, max(warmed, fraction / 0.1))
    fallen = min(1.0, max(0.0, fraction - constant) / (1 - constant))
    return optimisation.learning_rate * warmth * 0.5 * (1 + math.cos(math.pi * fallen))


class WeightAverage:
    """A copy of a network with the moving average of its weights."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.model = copy.deepcopy(model).requires_grad_(requires_grad=False).eval()
        """The averaged network."""
        self._decay = decay

    @torch.no_grad()
    def update(self, model: nn.Module, step: int) -> None:
        """Update the average after a step, counted from 0."""
        # Warm-up of the average: at step n the decay is at most (1 + n) / (10 + n).
        decay = min(self._decay, (1 + step) / (10.0 + step))
        averaged: list[Tensor] = list(self.model.parameters())
        get_ema_multi_avg_fn(decay)(averaged, [*model.parameters()], step)
        for mine, theirs in zip(self.model.buffers(), model.buffers(), strict=True):
            mine.copy_(theirs)


@contextlib.contextmanager
def prefetched(
    make: Callable[[int], _Item], *, first: int, ahead: int = 3
) -> Generator[Iterator[_Item], None, None]:
    """Iterator over ``make(first)``, ``make(first + 1)`` and so on, made in another thread.

    At most ``ahead`` items are ready; exceptions of ``make`` are raised in order.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="prefetch") as thread:
        waiting = deque(thread.submit(make, first + index) for index in range(ahead))

        def items() -> Iterator[_Item]:
            for index in itertools.count(first + ahead):
                item = waiting.popleft().result()
                waiting.append(thread.submit(make, index))
                yield item

        try:
            yield items()
        finally:
            thread.shutdown(cancel_futures=True)
