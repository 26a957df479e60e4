"""Exponential moving average of a network's weights."""

import copy

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

_FASTEST = 10.0
"""The average forgets its start: at step n no more than (1 + n) / (10 + n) is kept."""


class WeightAverage:
    """A second network whose weights follow those of the one that is trained."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.model = copy.deepcopy(model).requires_grad_(requires_grad=False).eval()
        """The averaged network."""
        self._decay = decay

    @torch.no_grad()
    def update(self, model: nn.Module, step: int) -> None:
        """Take in the weights after a step, counted from 0."""
        decay = min(self._decay, (1 + step) / (_FASTEST + step))
        averaged: list[Tensor] = list(self.model.parameters())
        get_ema_multi_avg_fn(decay)(averaged, [*model.parameters()], step)
        for mine, theirs in zip(self.model.buffers(), model.buffers(), strict=True):
            mine.copy_(theirs)
