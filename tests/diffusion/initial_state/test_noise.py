import pytest
import torch

from pd_editor.diffusion.initial_state.noise import (
    DIRECTION_NOISE,
    POSITION_NOISE_M,
    first_noise,
    noise_scale,
    preconditioning,
    sampling_levels,
)
from pd_editor.diffusion.initial_state.state_encoding import (
    POSITION_UNIT_M,
    STATE_SPREAD,
)


def test_noise_runs_over_its_range_in_equal_ratios():
    scale = noise_scale(torch.linspace(0, 1, 11))
    torch.testing.assert_close(
        scale[[0, -1], 0] * POSITION_UNIT_M, torch.tensor(POSITION_NOISE_M)
    )
    torch.testing.assert_close(scale[[0, -1], 3], torch.tensor(DIRECTION_NOISE))
    ratio = scale[1:] / scale[:-1]
    assert (ratio > 1).all()
    torch.testing.assert_close(ratio, ratio[:1].expand_as(ratio))


def test_below_level_zero_there_is_no_noise():
    assert not noise_scale(torch.tensor([-1.0])).any()


def test_input_and_target_of_the_network_have_unit_variance():
    random = torch.Generator().manual_seed(0)
    spread = torch.tensor(STATE_SPREAD)
    clean = torch.randn((50_000, 5), generator=random) * spread
    for level in (0.0, 0.3, 0.7, 1.0):
        scale = noise_scale(torch.tensor(level))
        noisy = clean + scale * torch.randn((50_000, 5), generator=random)
        factor_in, factor_skip, factor_out = preconditioning(scale)
        target = (clean - factor_skip * noisy) / factor_out
        for values in (noisy * factor_in, target):
            torch.testing.assert_close(
                values.std(dim=0), torch.ones(5), rtol=0.02, atol=0
            )


def test_without_noise_the_network_is_passed_by():
    _, skip, out = preconditioning(torch.zeros(5))
    assert skip.tolist() == [1.0] * 5
    assert out.tolist() == [0.0] * 5


def test_first_noise_is_as_wide_as_traffic_with_noise():
    noise = torch.randn((100_000, 5), generator=torch.Generator().manual_seed(1))
    spread = torch.tensor(STATE_SPREAD)
    expected = (noise_scale(torch.ones(())).square() + spread.square()).sqrt()
    torch.testing.assert_close(
        first_noise(noise).std(dim=0), expected, rtol=0.02, atol=0
    )


@pytest.mark.parametrize("num_steps", [1, 2, 20])
def test_levels_fall_from_one(num_steps: int):
    levels = sampling_levels(num_steps)
    assert len(levels) == num_steps
    assert levels[0] == 1.0
    assert levels == sorted(levels, reverse=True)
    assert num_steps == 1 or levels[-1] == 0.0
