from typing import get_args

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.generation.core.noise_schedule import (
    Prediction,
    ScheduleKind,
    VarianceExploding,
    VariancePreserving,
    centered_levels,
    even_levels,
    noised,
    preconditioning,
)

KINDS: list[ScheduleKind] = ["cosine"]
"""Schedules that end without signal; the paper's does not."""


@pytest.mark.parametrize("kind", KINDS)
def test_variance_is_preserved_and_the_signal_falls_from_all_to_nothing(
    kind: ScheduleKind,
) -> None:
    schedule = VariancePreserving(kind=kind)
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
    schedule = VariancePreserving(kind=kind)
    clean, noise = torch.randn(5), torch.randn(5)
    assert torch.equal(noised(schedule, clean, noise, torch.zeros(1)), clean)
    assert torch.equal(noised(schedule, clean, noise, torch.ones(1)), noise)


@settings(deadline=None)
@given(st.sampled_from(KINDS), st.sampled_from(get_args(Prediction)), st.data())
def test_the_clean_sample_comes_back_from_what_a_network_predicts(
    kind: ScheduleKind, prediction: Prediction, data: st.DataObject
) -> None:
    level = torch.tensor([data.draw(st.floats(0.0, 0.95))], dtype=torch.float64)
    schedule = VariancePreserving(kind=kind, prediction=prediction)
    clean, noise = torch.randn(2, 7, dtype=torch.float64)
    noisy = noised(schedule, clean, noise, level)
    alpha, sigma = schedule.alpha(level), schedule.sigma(level)
    outputs = {
        "clean": clean,
        "velocity": alpha * noise - sigma * clean,
        "noise": noise,
    }
    found = schedule.clean_of(outputs[prediction], noisy, level)
    assert torch.allclose(found, clean, atol=1e-4 if prediction == "noise" else 1e-9)


EXPLODING = VarianceExploding((0.002, 0.04), (1.3, 3.0))


def test_exploding_noise_runs_over_its_range_in_equal_ratios() -> None:
    sigma = EXPLODING.sigma(torch.linspace(0, 1, 11)[:, None])
    torch.testing.assert_close(sigma[0], torch.tensor([0.002, 0.04]))
    torch.testing.assert_close(sigma[-1], torch.tensor([1.3, 3.0]))
    ratio = sigma[1:] / sigma[:-1]
    assert (ratio > 1).all()
    torch.testing.assert_close(ratio, ratio[:1].expand_as(ratio))


def test_below_level_zero_there_is_no_noise() -> None:
    assert not EXPLODING.sigma(torch.tensor([-1.0])).any()


def test_input_and_target_of_a_preconditioned_network_have_unit_variance() -> None:
    random = torch.Generator().manual_seed(0)
    spread = torch.tensor([0.5, 0.8])
    clean = torch.randn((50_000, 2), generator=random) * spread
    for level in (0.0, 0.3, 0.7, 1.0):
        sigma = EXPLODING.sigma(torch.tensor([level]))
        noisy = clean + sigma * torch.randn((50_000, 2), generator=random)
        factor_in, factor_skip, factor_out = preconditioning(sigma, spread)
        target = (clean - factor_skip * noisy) / factor_out
        for values in (noisy * factor_in, target):
            torch.testing.assert_close(
                values.std(dim=0), torch.ones(2), rtol=0.02, atol=0
            )


def test_without_noise_a_preconditioned_network_is_passed_by() -> None:
    _, skip, out = preconditioning(torch.zeros(2), torch.ones(2))
    assert skip.tolist() == [1.0, 1.0]
    assert out.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("num_steps", [1, 2, 20])
def test_centered_levels_fall_from_one_to_zero(num_steps: int) -> None:
    levels = centered_levels(num_steps, 0.3)
    assert len(levels) == num_steps
    assert levels[0] == 1.0
    assert levels == sorted(levels, reverse=True)
    assert num_steps == 1 or levels[-1] == 0.0


def test_even_levels_fall_evenly() -> None:
    assert even_levels(4) == [1.0, 0.75, 0.5, 0.25]
