import pytest
import torch
from torch import nn

from pd_editor.experiments.training.train_loop import WeightAverage


def constant(value):
    model = nn.Linear(1, 1, bias=False)
    nn.init.constant_(model.weight, value)
    return model


def test_it_is_the_weighted_sum_of_all_weights_there_were():
    decay, values = 0.9, [3.0, -1.0, 2.0, 5.0]
    average = WeightAverage(constant(7.0), decay)
    late = 10_000
    for value in values:
        average.update(constant(value), late)
    expected = 7.0 * decay**4 + sum(
        (1 - decay) * decay ** (3 - k) * value for k, value in enumerate(values)
    )
    assert average.model.weight.item() == pytest.approx(expected, rel=1e-6)


def test_it_starts_fast():
    average = WeightAverage(constant(0.0), 0.999)
    average.update(constant(1.0), 0)
    assert average.model.weight.item() == pytest.approx(0.9)


def test_constant_weights_stay_and_the_source_is_untouched():
    model = constant(2.0)
    average = WeightAverage(model, 0.5)
    for step in range(20):
        average.update(model, step)
    assert average.model.weight.item() == model.weight.item() == 2.0
    assert not average.model.weight.requires_grad
    assert model.weight.requires_grad


def test_buffers_are_copied():
    model = nn.BatchNorm1d(2)
    average = WeightAverage(model, 0.9)
    model.get_buffer("running_mean").fill_(4.0)
    average.update(model, 0)
    assert torch.equal(average.model.get_buffer("running_mean"), torch.tensor([4.0, 4]))
