"""Sampler of both stages: denoises samples over decreasing noise levels."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.generation.core.devices import threads_for
from pd_editor.generation.core.noise_schedule import NoiseSchedule

Denoise = Callable[[Tensor, int], Tensor]
"""Predicts clean samples from noisy ones [S ... P] and the index of their level."""


@dataclass(frozen=True, kw_only=True)
class SamplerConfig:
    """Settings of the step from one noise level to the next."""

    eta: float = 0.0
    """Stochasticity: 0 adds no fresh noise but for ``clean_variance`` (DDIM), 1 is
    ancestral sampling."""
    extrapolation: tuple[float, ...] = (0.0,)
    """For each part of a sample: 0 uses the predicted clean sample (first order), 1
    extrapolates the predictions of the last two steps (second order)."""
    clean_variance: Float[Tensor, "T #P"] | None = None
    """Variance of the clean sample about its prediction at each step, for each part; None
    stands for 0."""
    num_gradient_steps: int = 0
    """Number of last steps that are differentiable."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplerStep:
    """State after a step."""

    index: int
    """Index of the step, from 0."""
    num_steps: int
    clean: Float[Tensor, "S ..."]
    """Predicted clean samples; after the last step they are the result."""


Sampler = Callable[
    [
        Denoise,
        Tensor,
        NoiseSchedule,
        Sequence[float],
        SamplerConfig,
        Callable[[], Tensor],
    ],
    Iterator[SamplerStep],
]
"""A function such as ``sample_steps``."""


def sample_steps(
    denoise: Denoise,
    start: Float[Tensor, "S ..."],
    schedule: NoiseSchedule,
    levels: Sequence[float],
    config: SamplerConfig,
    fresh_noise: Callable[[], Tensor],
) -> Iterator[SamplerStep]:
    """Denoise ``start``, which is at ``levels[0]``, once at each level.

    ``fresh_noise`` draws standard normal numbers of its shape. A caller stops by not
    requesting the next step. Between steps torch has the caller's settings.

    Source: Song et al., Denoising diffusion implicit models, 2021, equation 12, for
    any amplitudes of signal and noise; second order as in Lu et al., DPM-Solver++, 2022
    (2M, and its stochastic form); variance of the clean sample as in Bao et al.,
    Analytic-DPM, 2022, equation 8.
    """
    noisy, last = start, None
    table = torch.tensor(levels, dtype=torch.float64, device="cpu")[:, None]
    alphas = schedule.alpha(table).to(start)
    sigmas = schedule.sigma(table).to(start)
    slopes = _slopes(alphas, sigmas) * start.new_tensor(config.extrapolation)
    kept, fresh = _noise_shares(alphas, sigmas, config.eta)
    if config.clean_variance is not None:
        share = alphas[1:] - kept * alphas[:-1] / sigmas[:-1]
        variance = share.square() * config.clean_variance[:-1].to(start)
        fresh = (fresh.square() + variance).sqrt()
    has_fresh = config.eta > 0 or config.clean_variance is not None
    first_gradient = len(levels) - config.num_gradient_steps
    for index in range(len(levels)):
        has_gradient = index >= first_gradient if config.num_gradient_steps else None
        with sampling_mode(start[..., 0].numel(), has_gradient=has_gradient):
            clean = denoise(noisy, index)
            if index + 1 < len(levels):
                better = clean
                if last is not None and any(config.extrapolation):
                    better = torch.addcmul(clean, slopes[index], clean - last)
                noise = (noisy - alphas[index] * better) / sigmas[index]
                noisy = alphas[index + 1] * better + kept[index] * noise
                if has_fresh:
                    normal = fresh_noise().to(start)
                    noisy = torch.addcmul(noisy, fresh[index], normal)
                last = clean
        yield SamplerStep(index=index, num_steps=len(levels), clean=clean)


@dataclass(frozen=True, kw_only=True)
class DifferentiableSampler:
    """``sample_steps`` of which the last steps are differentiable."""

    num_steps: int

    def __call__(
        self,
        denoise: Denoise,
        start: Float[Tensor, "S ..."],
        schedule: NoiseSchedule,
        levels: Sequence[float],
        config: SamplerConfig,
        fresh_noise: Callable[[], Tensor],
    ) -> Iterator[SamplerStep]:
        """Denoise ``start`` once at each level."""
        config = replace(config, num_gradient_steps=self.num_steps)
        return sample_steps(denoise, start, schedule, levels, config, fresh_noise)


def _slopes(
    alphas: Float[Tensor, "T #P"], sigmas: Float[Tensor, "T #P"]
) -> Float[Tensor, "T #P"]:
    """Extrapolation factor of each step, relative to the last two predictions.

    Half the ratio of the step's length to that of the previous one, in logarithms of the
    signal-to-noise ratio: 0.5 for even steps.
    """
    length = (alphas / sigmas).log().diff(dim=0)
    slopes = torch.zeros_like(alphas + sigmas)
    slopes[1:-1] = 0.5 * length[1:] / length[:-1]
    return slopes


def _noise_shares(
    alphas: Float[Tensor, "T #P"], sigmas: Float[Tensor, "T #P"], eta: float
) -> tuple[Float[Tensor, "T_minus_1 #P"], Float[Tensor, "T_minus_1 #P"]]:
    """Amplitudes, after each step, of the noise that is kept and of fresh noise."""
    sigma, next_sigma = sigmas[:-1], sigmas[1:]
    ratio = alphas[:-1] * next_sigma / (alphas[1:] * sigma)
    fresh = eta * next_sigma * (1 - ratio.square()).clamp_min(0).sqrt()
    return (next_sigma.square() - fresh.square()).clamp_min(0).sqrt(), fresh


def preparing_mode(
    num_rows: int, sampler: Sampler
) -> contextlib.AbstractContextManager[None]:
    """``sampling_mode`` of what is computed before the first step of a sampler."""
    is_differentiable = isinstance(sampler, DifferentiableSampler)
    return sampling_mode(num_rows, has_gradient=True if is_differentiable else None)


@contextlib.contextmanager
def sampling_mode(num_rows: int, *, has_gradient: bool | None = None) -> Iterator[None]:
    """Context without gradients and autocast, with few threads for few rows.

    Sines of large angles need float32, which autocast does not preserve.

    Args:
        num_rows: Number of agents times samples.
        has_gradient: Whether gradients are recorded; None: never, so that tensors cannot
            be used in a later computation of gradients, which saves time.
    """
    with threads_for(num_rows), contextlib.ExitStack() as stack:
        stack.enter_context(
            torch.inference_mode()
            if has_gradient is None
            else torch.set_grad_enabled(has_gradient)
        )
        for device in ("cpu", "cuda"):
            if torch.is_autocast_enabled(device):
                stack.enter_context(torch.autocast(device, enabled=False))
        yield
