import math
from functools import partial

import pytest
import torch
from scipy import stats

from examples.own_sampler import ancestral
from pd_editor.generation.core import devices, sampler
from pd_editor.generation.core.noise_schedule import (
    NoiseSchedule,
    ScheduleKind,
    VarianceExploding,
    VariancePreserving,
    even_levels,
)
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.core.sampler import (
    Sampler,
    SamplerConfig,
    SamplerStep,
    sample_steps,
)

MEAN, SPREAD = 2.0, 0.5


def drawn(
    schedule: NoiseSchedule, eta: float, samples: range, num_steps: int, size: int = 4
) -> torch.Tensor:
    """Sampled with the exact denoiser of a Gaussian."""
    streams = RandomStreams(3, "gauss", samples)
    levels = even_levels(num_steps)

    def denoise(noisy: torch.Tensor, index: int) -> torch.Tensor:
        at = torch.tensor([levels[index]], dtype=torch.float64)
        alpha, sigma = float(schedule.alpha(at)), float(schedule.sigma(at))
        gain = SPREAD**2 * alpha / ((alpha * SPREAD) ** 2 + sigma**2)
        return MEAN + gain * (noisy - alpha * MEAN)

    last: SamplerStep | None = None
    first = torch.ones(1, dtype=torch.float64)
    start = streams.normal(size, 1) * float(schedule.sigma(first))
    start = start + MEAN * float(schedule.alpha(first))
    config = SamplerConfig(eta=eta)
    for step in sample_steps(
        denoise, start, schedule, levels, config, partial(streams.normal, size, 1)
    ):
        last = step
    assert last is not None
    assert last.index == num_steps - 1
    return last.clean[..., 0]


@pytest.mark.parametrize(
    "schedule", [VariancePreserving(), VarianceExploding((0.05, 0.1), (4.0, 3.0))]
)
def test_the_example_of_an_own_sampler_is_ancestral(schedule: NoiseSchedule) -> None:
    levels, start = even_levels(6), RandomStreams(1, "start", range(3)).normal(4, 2)

    def last(sampler: Sampler) -> torch.Tensor:
        noise = partial(RandomStreams(2, "fresh", range(3)).normal, 4, 2)
        config = SamplerConfig(eta=1.0)
        *_, step = sampler(
            lambda noisy, index: (noisy + index).tanh(),
            start,
            schedule,
            levels,
            config,
            noise,
        )
        return step.clean

    torch.testing.assert_close(last(ancestral), last(sample_steps))


@pytest.mark.parametrize("eta", [0.3, 1.0])
def test_the_variance_of_the_clean_sample_keeps_the_spread_of_few_steps(
    eta: float,
) -> None:
    """The exact one: then each step samples the next level's Gaussian exactly."""
    schedule = VarianceExploding((0.05,), (4.0,))
    levels = [1.0, 0.7, 0.3, 0.0]
    sigma = schedule.sigma(torch.tensor(levels, dtype=torch.float64)[:, None])
    variance = SPREAD**2 * sigma**2 / (SPREAD**2 + sigma**2)

    def spread(config: SamplerConfig) -> float:
        streams = RandomStreams(3, "gauss", range(4000))
        noisy_spread = float((SPREAD**2 + sigma[0] ** 2).sqrt())
        start = (MEAN + noisy_spread * streams.normal(4, 1)).double()
        found: list[torch.Tensor] = []

        def denoise(noisy: torch.Tensor, index: int) -> torch.Tensor:
            found.append(noisy)
            return MEAN + variance[index] / sigma[index] ** 2 * (noisy - MEAN)

        for _ in sample_steps(
            denoise, start, schedule, levels, config, partial(streams.normal, 4, 1)
        ):
            pass
        return float(found[-1].std())

    wanted = float((SPREAD**2 + sigma[-1] ** 2).sqrt())
    with_variance = spread(SamplerConfig(eta=eta, clean_variance=variance))
    assert with_variance == pytest.approx(wanted, rel=0.02)
    assert spread(SamplerConfig(eta=eta)) < 0.9 * wanted


def schedule_of(kind: ScheduleKind | None) -> NoiseSchedule:
    if kind is None:
        return VarianceExploding((0.01,), (40.0,))
    return VariancePreserving(kind=kind)


@pytest.mark.parametrize("kind", ["cosine", None])
@pytest.mark.parametrize("eta", [0.0, 0.5, 1.0])
def test_ends_in_the_mean_and_variance_of_a_gaussian(
    kind: ScheduleKind | None, eta: float
) -> None:
    count = 20_000
    found = drawn(schedule_of(kind), eta, range(1), 200, count)
    error = 4 / math.sqrt(count)
    assert abs(found.mean() - MEAN) < error * SPREAD + 0.005
    assert abs(found.std() / SPREAD - 1) < error + 0.03


def test_a_sample_is_the_same_alone_and_among_others() -> None:
    schedule = VariancePreserving()
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
    calls: list[int] = []

    def denoise(noisy: torch.Tensor, index: int) -> torch.Tensor:
        calls.append(index)
        return noisy * 0

    steps = sample_steps(
        denoise,
        torch.ones(1, 2),
        VariancePreserving(),
        even_levels(10),
        SamplerConfig(),
        partial(torch.randn, 1, 2),
    )
    assert next(steps).num_steps == 10
    next(steps)
    assert calls == [0, 1]


def test_between_steps_torch_is_as_the_caller_set_it() -> None:
    seen: list[tuple[bool, bool]] = []

    def denoise(noisy: torch.Tensor, _: int) -> torch.Tensor:
        seen.append(
            (torch.is_inference_mode_enabled(), torch.is_autocast_enabled("cpu"))
        )
        return noisy * 0

    with torch.autocast("cpu", torch.bfloat16):
        for _ in sample_steps(
            denoise,
            torch.ones(1, 2),
            VariancePreserving(),
            even_levels(2),
            SamplerConfig(),
            partial(torch.randn, 1, 2),
        ):
            assert torch.is_autocast_enabled("cpu")
            assert not torch.is_inference_mode_enabled()
    assert seen == [(True, False)] * 2


@pytest.mark.parametrize(("num_rows", "threads"), [(32, 1), (300, 2), (5000, 3)])
def test_threads_are_for_many_rows(num_rows: int, threads: int) -> None:
    before = torch.get_num_threads()
    devices._usual_threads.cache_clear()
    torch.set_num_threads(3)
    try:
        with sampler.sampling_mode(num_rows):
            assert torch.get_num_threads() == threads
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)
        devices._usual_threads.cache_clear()


def test_second_order_is_more_exact_where_steps_are_uneven() -> None:
    """Against the exact flow of a Gaussian; part 0 is first order, part 1 second."""
    schedule = VarianceExploding((0.01,), (40.0,))

    def error(num_steps: int, ratio: float) -> torch.Tensor:
        # Long and short steps take turns.
        lengths = torch.tensor([1.0, ratio]).repeat(num_steps // 2).double()
        done = torch.cat([torch.zeros(1).double(), lengths.cumsum(0) / lengths.sum()])
        levels = [*(1 - done).tolist()[:-1], 0.0]

        def denoise(noisy: torch.Tensor, index: int) -> torch.Tensor:
            at = torch.tensor([levels[index]], dtype=torch.float64)
            gain = SPREAD**2 / (SPREAD**2 + schedule.sigma(at).square())
            return MEAN + gain * (noisy - MEAN)

        start = 40.0 * torch.ones((1, 1, 2), dtype=torch.float64)
        *_, last = sample_steps(
            denoise,
            start,
            schedule,
            levels,
            SamplerConfig(extrapolation=(0.0, 1.0)),
            partial(torch.randn, 1, 1, 2),
        )
        sigma = schedule.sigma(torch.zeros(1, dtype=torch.float64))
        gain = SPREAD**2 / (SPREAD**2 + sigma.square())
        exact = (SPREAD**2 + sigma.square()) / (SPREAD**2 + 40.0**2)
        expected = MEAN + gain * exact.sqrt() * (40.0 - MEAN)
        return (last.clean - expected).abs()[0, 0]

    for ratio in (1.0, 2.0):
        coarse, fine = error(40, ratio), error(160, ratio)
        assert fine[1] < 0.2 * fine[0]
        assert fine[0] > 0.15 * coarse[0]
        assert fine[1] < 0.1 * coarse[1]
