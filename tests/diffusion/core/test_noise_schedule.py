from typing import get_args

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.diffusion.core.noise_schedule import (
    NoiseSchedule,
    Prediction,
    ScheduleKind,
)

KINDS = get_args(ScheduleKind)


@pytest.mark.parametrize("kind", KINDS)
def test_variance_is_preserved_and_the_signal_falls_from_all_to_nothing(
    kind: ScheduleKind,
) -> None:
    schedule = NoiseSchedule(kind=kind)
    level = torch.linspace(0, 1, 1001, dtype=torch.float64)
    alpha, sigma = schedule.alpha(level), schedule.sigma(level)
    assert torch.allclose(alpha**2 + sigma**2, torch.ones_like(level))
    assert (alpha[1:] < alpha[:-1]).all()
    assert (sigma[1:] > sigma[:-1]).all()
    assert alpha[0] == 1.0
    assert alpha[-1] == 0.0
    assert sigma[-1] == 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_ends_are_exact_in_single_precision(kind: ScheduleKind) -> None:
    schedule = NoiseSchedule(kind=kind)
    clean, noise = torch.randn(5), torch.randn(5)
    assert torch.equal(schedule.noised(clean, noise, torch.zeros(1)), clean)
    assert torch.equal(schedule.noised(clean, noise, torch.ones(1)), noise)


@settings(deadline=None)
@given(st.sampled_from(KINDS), st.sampled_from(get_args(Prediction)), st.data())
def test_the_clean_sample_comes_back_from_what_a_network_predicts(
    kind: ScheduleKind, prediction: Prediction, data: st.DataObject
) -> None:
    level = torch.tensor(data.draw(st.floats(0.0, 0.95)), dtype=torch.float64)
    schedule = NoiseSchedule(kind=kind, prediction=prediction)
    clean, noise = torch.randn(2, 7, dtype=torch.float64)
    noisy = schedule.noised(clean, noise, level)
    alpha, sigma = schedule.alpha(level), schedule.sigma(level)
    outputs = {
        "clean": clean,
        "velocity": alpha * noise - sigma * clean,
        "noise": noise,
    }
    found = schedule.clean_of(outputs[prediction], noisy, level)
    assert torch.allclose(found, clean, atol=1e-4 if prediction == "noise" else 1e-9)
