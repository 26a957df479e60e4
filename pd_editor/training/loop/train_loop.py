"""The loop that trains either stage, on a CPU or on one or several GPUs."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn

from pd_editor.errors import TrainingError
from pd_editor.training.config.run_config import Budget, Optimisation, RunConfig
from pd_editor.training.data.batch_sampler import BatchSampler
from pd_editor.training.data.batched_scenes import Batch, TrainingData
from pd_editor.training.data.prefetch import prefetched
from pd_editor.training.loop.run_folder import RunFolder
from pd_editor.training.loop.training_state import Standing, read_state, write_state
from pd_editor.training.loop.weight_average import WeightAverage

_STEPS_PER_LINE = 25
_BETAS = (0.9, 0.99)
"""The second is below the usual 0.999, since runs are short."""
_AUGMENT, _NOISE, _HELD_OUT = 1, 2, 3


Loss = Callable[[Any, Any, torch.Generator, float], tuple[Tensor, Mapping[str, Tensor]]]
"""Loss of a network on a batch, and its parts by name; random numbers on the CPU, and
the share of the training that is done."""


@dataclass(frozen=True, kw_only=True)
class TrainingProgress:
    """Where a run is."""

    standing: Standing
    fraction: float
    """Of the budget that is spent."""
    loss: float
    """Mean of the last steps."""
    held_out_loss: float
    """At the last validation; NaN before the first."""
    scenes_per_s: float
    left_s: float


class _Work:
    """A step's input, in a wrapping that the library does not look into."""

    def __init__(self, batch: Batch, random: torch.Generator, progress: float) -> None:
        self.batch, self.random, self.progress = batch, random, progress


class _LossModule(nn.Module):
    """The network with its loss as one forward pass, as data parallelism needs it."""

    def __init__(self, model: nn.Module, loss: Loss) -> None:
        super().__init__()
        self.model, self._loss = model, loss

    def forward(self, work: _Work) -> tuple[Tensor, dict[str, Tensor]]:
        loss, parts = self._loss(self.model, work.batch, work.random, work.progress)
        return loss, {name: part.detach() for name, part in parts.items()}


class TrainLoop:
    """A run in progress: the network, its average, its optimiser, and where it stands."""

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
        self.standing = Standing()
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
        """Of the averaged network at the last validation."""

    @property
    def averaged_model(self) -> nn.Module:
        """What the run is for."""
        return self._average.model

    def resume(self) -> None:
        """Go to where the folder's checkpoint stands.

        Raises:
            ModelError: it is damaged or of another network.
        """
        self.standing = read_state(
            self._folder.state_path,
            model=self._model,
            average=self._average.model,
            optimiser=self._optimiser.optimizer,
        )
        if self._fabric.is_global_zero:
            self._folder.forget_after(self.standing.step)

    def run(
        self,
        *,
        is_stopped: Callable[[], bool] = lambda: False,
        on_checkpoint: Callable[[], None] = lambda: None,
    ) -> Iterator[TrainingProgress]:
        """Train until the budget is spent or somebody asks to stop.

        A checkpoint is written every few minutes and at the end. Whoever stops
        iterating loses what came after the last one.

        Args:
            is_stopped: Asked after each step.
            on_checkpoint: Called after each checkpoint, on the first process.

        Yields:
            Progress, every few steps.

        Raises:
            TrainingError: the loss is no longer a number.
        """
        budget, recent = self._config.budget, RecentSteps()
        checked_s = self.standing.trained_s
        began = time.perf_counter() - self.standing.trained_s
        is_over = spent(budget, self.standing) >= 1
        with prefetched(self._batch, first=self.standing.step) as batches:
            while not is_over:
                recent.add(*self._step(next(batches)))
                trained_s, must_stop = self._fabric.broadcast(
                    (time.perf_counter() - began, is_stopped())
                )
                self.standing = Standing(
                    step=self.standing.step + 1, trained_s=trained_s
                )
                is_over = must_stop or spent(budget, self.standing) >= 1
                is_due = (
                    is_over or trained_s - checked_s > 60 * budget.checkpoint_minutes
                )
                if is_due or recent.count + recent.num_left_out >= _STEPS_PER_LINE:
                    yield self._reported(recent)
                    if is_due:
                        checked_s = trained_s
                        self._checkpoint(on_checkpoint, is_hasty=must_stop)
                    recent = RecentSteps()

    def _batch(self, step: int) -> Batch:
        """This process's part of a step's scenes."""
        rows = self._sampler.rows(step)
        fabric = self._fabric
        return self._data.batch(rows[fabric.global_rank :: fabric.world_size])

    def _random(self, purpose: int, index: int) -> torch.Generator:
        """Random numbers of a step; they need no memory of the steps before."""
        config, rank = self._config, self._fabric.global_rank
        state = np.random.SeedSequence([config.seed, purpose, index, rank])
        generator = torch.Generator()
        generator.manual_seed(int(state.generate_state(1, np.uint64)[0] >> 1))
        return generator

    def _step(self, batch: Batch) -> tuple[Tensor, Mapping[str, Tensor], float]:
        """One step: loss, its parts, and the length of the gradient."""
        step, optimisation = self.standing.step, self._config.optimisation
        progress = spent(self._config.budget, self.standing)
        rate = learning_rate(optimisation, step, progress)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        moved = batch.to(self._fabric.device)
        moved = self._data.augment(moved, self._random(_AUGMENT, step))
        loss, parts = self._module(_Work(moved, self._random(_NOISE, step), progress))
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

    def _reported(self, recent: "RecentSteps") -> TrainingProgress:
        standing, fabric = self.standing, self._fabric
        entry = recent.entry(standing)
        if fabric.is_global_zero:
            self._folder.log(entry)
        fraction = min(1.0, spent(self._config.budget, standing))
        speed = recent.count * self._config.optimisation.batch_size / recent.seconds
        left = (1 - fraction) * standing.trained_s / max(fraction, 1e-6)
        return TrainingProgress(
            standing=standing,
            fraction=fraction,
            loss=entry["loss"],
            held_out_loss=self.held_out_loss,
            scenes_per_s=speed,
            left_s=left,
        )

    def _checkpoint(self, on_checkpoint: Callable[[], None], *, is_hasty: bool) -> None:
        """Write where the run stands; validate, unless somebody waits."""
        if not is_hasty and len(self._data.held_out_rows):
            entry = self._validated()
            self.held_out_loss = entry["loss"]
            if self._fabric.is_global_zero:
                self._folder.log(entry)
        if self._fabric.is_global_zero:
            write_state(
                self._folder.state_path,
                self.standing,
                model=self._model,
                average=self._average.model,
                optimiser=self._optimiser.optimizer,
            )
            on_checkpoint()
        self._fabric.barrier()

    @torch.no_grad()
    def _validated(self) -> dict[str, Any]:
        """Loss of the averaged network on held-out scenes, always with equal noise."""
        rows, recent = self._data.held_out_rows, RecentSteps()
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
        return recent.entry(self.standing, held_out=True)


class RecentSteps:
    """Losses of the last steps, for the log."""

    def __init__(self) -> None:
        self.count = 0
        self.num_left_out = 0
        self._began = time.perf_counter()
        self._sums: dict[str, Tensor] = {}
        self._norm = 0.0

    @property
    def seconds(self) -> float:
        """Time since it began."""
        return max(time.perf_counter() - self._began, 1e-9)

    def add(self, loss: Tensor, parts: Mapping[str, Tensor], norm: float) -> None:
        """Take in a step; one without a finite gradient has been left out."""
        if not math.isfinite(norm):
            self.num_left_out += 1
            return
        self.count += 1
        self._norm += norm
        for name, value in {"": loss, **parts}.items():
            earlier = self._sums.get(name, 0.0)
            self._sums[name] = earlier + value.detach().float()

    def entry(self, standing: Standing, *, held_out: bool = False) -> dict[str, Any]:
        """A line of the log: means over the steps.

        Raises:
            TrainingError: the loss is no number.
        """
        means = {name: float(one) / self.count for name, one in self._sums.items()}
        loss = means.pop("", math.nan)
        if not math.isfinite(loss):
            raise TrainingError(
                f"The loss became {loss} around step {standing.step}; begin again with "
                "a lower learning rate."
            )
        entry = {
            "step": standing.step,
            "minutes": round(standing.trained_s / 60, 4),
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
    """The optimiser; only matrices decay."""
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


def spent(budget: Budget, standing: Standing) -> float:
    """Share of the budget that is spent; 1 or more when it is over."""
    if budget.steps is not None:
        return standing.step / budget.steps
    return standing.trained_s / (60 * budget.minutes)


def learning_rate(optimisation: Optimisation, step: int, fraction: float) -> float:
    """Warms up over steps; stays; falls to zero as half a cosine over the budget."""
    constant = optimisation.constant_share
    warmth = min(1.0, (step + 1) / (optimisation.warmup_steps + 1))
    fallen = min(1.0, max(0.0, fraction - constant) / (1 - constant))
    return optimisation.learning_rate * warmth * 0.5 * (1 + math.cos(math.pi * fallen))
