"""From noise to a sample, one noise level after another; knows no model."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.diffusion.core.noise_schedule import NoiseSchedule
from pd_editor.diffusion.core.random_streams import RandomStreams

Denoise = Callable[[Tensor, float], Tensor]
"""From a noisy sample and its level to the clean sample that is believed in."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplerStep:
    """State after a step."""

    index: int
    """From 0."""
    num_steps: int
    level: float
    """Noise level of ``sample``; 0 after the last step."""
    sample: Float[Tensor, "S ..."]
    clean: Float[Tensor, "S ..."]
    """What the step took for the clean sample."""


def levels_of(num_steps: int) -> list[float]:
    """Levels from 1 down to 0, evenly spaced; one more than steps."""
    assert num_steps >= 1, "a sample takes at least one step"
    return [(num_steps - i) / num_steps for i in range(num_steps + 1)]


def ddim(
    denoise: Denoise,
    start: Float[Tensor, "S ..."],
    schedule: NoiseSchedule,
    levels: list[float],
    *,
    eta: float = 0.0,
    streams: RandomStreams | None = None,
) -> Iterator[SamplerStep]:
    """Denoise ``start``, which is at ``levels[0]``, a step for each further level.

    Song et al. 2021, equation 12. ``eta`` is the share of fresh noise: 0 draws none,
    1 is ancestral sampling, for which ``streams`` must be given. A caller stops by
    not asking for the next step.
    """
    assert eta == 0.0 or streams is not None, "fresh noise needs random streams"
    table = torch.tensor(levels, dtype=torch.float64, device="cpu")
    alphas, sigmas = schedule.alpha(table).tolist(), schedule.sigma(table).tolist()
    sample = start
    for index in range(len(levels) - 1):
        clean = denoise(sample, levels[index])
        alpha, sigma = alphas[index], sigmas[index]
        next_alpha, next_sigma = alphas[index + 1], sigmas[index + 1]
        noise = (sample - alpha * clean) / sigma
        left = max(1 - (alpha / next_alpha) ** 2, 0.0)
        fresh = eta * next_sigma / sigma * left**0.5
        kept = max(next_sigma**2 - fresh**2, 0.0) ** 0.5
        sample = next_alpha * clean + kept * noise
        if fresh > 0.0 and streams is not None:
            sample = sample + fresh * streams.normal(*start.shape[1:]).to(sample)
        yield SamplerStep(
            index=index,
            num_steps=len(levels) - 1,
            level=levels[index + 1],
            sample=sample,
            clean=clean,
        )
