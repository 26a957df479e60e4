"""Exponential moving average of a network's weights."""

import copy

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

_FASTEST = 10.0
"""Warm-up of the average: at step n the decay is at most (1 + n) / (10 + n)."""


class WeightAverage:
    """A copy of a network with the moving average of its weights."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.model = copy.deepcopy(model).requires_grad_(requires_grad=False).eval()
        """The averaged network."""
        self._decay = decay

    @torch.no_grad()
    def update(self, model: nn.Module, step: int) -> None:
        """Update the average after a step, counted from 0."""
        decay = min(self._decay, (1 + step) / (_FASTEST + step))
        averaged: list[Tensor] = list(self.model.parameters())
        get_ema_multi_avg_fn(decay)(averaged, [*model.parameters()], step)
        for mine, theirs in zip(self.model.buffers(), model.buffers(), strict=True):
            mine.copy_(theirs)
