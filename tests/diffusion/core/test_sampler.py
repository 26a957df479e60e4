import math

import pytest
import torch
from scipy import stats

from pd_editor.diffusion.core.noise_schedule import NoiseSchedule, ScheduleKind
from pd_editor.diffusion.core.random_streams import RandomStreams
from pd_editor.diffusion.core.sampler import SamplerStep, ddim, levels_of

MEAN, SPREAD = 2.0, 0.5


def drawn(
    schedule: NoiseSchedule, eta: float, samples: range, num_steps: int, size: int = 4
) -> torch.Tensor:
    """Sampled with the exact denoiser of a Gaussian."""
    streams = RandomStreams(3, "gauss", samples)

    def denoise(noisy: torch.Tensor, level: float) -> torch.Tensor:
        at = torch.tensor(level, dtype=torch.float64)
        alpha, sigma = float(schedule.alpha(at)), float(schedule.sigma(at))
        gain = SPREAD**2 * alpha / ((alpha * SPREAD) ** 2 + sigma**2)
        return MEAN + gain * (noisy - alpha * MEAN)

    last: SamplerStep | None = None
    start = streams.normal(size)
    levels = levels_of(num_steps)
    for step in ddim(denoise, start, schedule, levels, eta=eta, streams=streams):
        last = step
    assert last is not None
    assert last.level == 0.0
    return last.sample


@pytest.mark.parametrize("kind", ["cosine", "linear"])
@pytest.mark.parametrize("eta", [0.0, 0.5, 1.0])
def test_ends_in_the_mean_and_variance_of_a_gaussian(
    kind: ScheduleKind, eta: float
) -> None:
    count = 20_000
    found = drawn(NoiseSchedule(kind=kind), eta, range(1), 200, count)
    error = 4 / math.sqrt(count)
    assert abs(found.mean() - MEAN) < error * SPREAD + 0.005
    assert abs(found.std() / SPREAD - 1) < error + 0.03


def test_a_sample_is_the_same_alone_and_among_others() -> None:
    schedule = NoiseSchedule()
    together = drawn(schedule, 1.0, range(6), 10)
    assert torch.equal(drawn(schedule, 1.0, range(4, 5), 10)[0], together[4])
    assert torch.equal(drawn(schedule, 1.0, range(2, 5), 10), together[2:5])


def test_samples_stages_and_seeds_are_independent() -> None:
    draws = [
        RandomStreams(seed, stage, [sample]).normal(8)
        for seed, stage, sample in [(0, "a", 0), (0, "a", 1), (0, "b", 0), (1, "a", 0)]
    ]
    assert all(
        not torch.equal(one, two) for one in draws for two in draws if one is not two
    )


def test_a_few_samples_cover_what_is_likely() -> None:
    quantile = torch.special.ndtr(
        RandomStreams(5, "a", range(6)).spread_normal(400, 3)[..., 0]
    )
    gaps = torch.diff(quantile.sort(dim=0).values, dim=0)
    # Six numbers at random leave a gap over 0.35 in most cases.
    assert gaps.max() < 0.28
    assert gaps.min() > 0.05


def test_each_sample_of_those_that_are_spread_is_normal_by_itself() -> None:
    first, fourth = RandomStreams(5, "a", [0, 3]).spread_normal(20_000, 2)
    for one in (first, fourth):
        assert stats.kstest(one[:, 0].numpy(), "norm").pvalue > 0.01
        assert stats.kstest(one[:, 1].numpy(), "norm").pvalue > 0.01
        assert abs(torch.corrcoef(one.T)[0, 1]) < 0.03


def test_a_spread_sample_is_the_same_alone_and_tries_are_independent() -> None:
    together = RandomStreams(2, "a", range(8)).spread_normal(500, 2, num_tries=2)
    alone = RandomStreams(2, "a", [5]).spread_normal(500, 2, num_tries=2)
    assert torch.equal(together[5], alone[0])
    first = torch.special.ndtr(together[..., 0])
    spread = (first[2] - first[0]).remainder(1)
    torch.testing.assert_close(
        spread, torch.full_like(spread, 0.618), rtol=0, atol=0.01
    )
    assert abs(torch.corrcoef(first[:2])[0, 1]) < 0.15


def test_nothing_is_computed_after_the_last_step_asked_for() -> None:
    calls: list[float] = []

    def denoise(noisy: torch.Tensor, level: float) -> torch.Tensor:
        calls.append(level)
        return noisy * 0

    steps = ddim(denoise, torch.ones(1, 2), NoiseSchedule(), levels_of(10))
    next(steps)
    next(steps)
    steps.close()
    assert len(calls) == 2


def test_levels_fall_evenly_to_zero() -> None:
    assert levels_of(4) == [1.0, 0.75, 0.5, 0.25, 0.0]
