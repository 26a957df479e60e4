"""A sampler of one's own: ancestral sampling of both stages.

pd-editor generate signalised-junction --model examples.own_sampler:generator --out out
"""

from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

from pd_editor.base.installed_files import models_folder
from pd_editor.generation.core.noise_schedule import NoiseSchedule
from pd_editor.generation.core.sampler import (
    Denoise,
    SamplerConfig,
    SamplerStep,
    sampling_mode,
)
from pd_editor.generation.path_diffuser import PathDiffuser


def ancestral(
    denoise: Denoise,
    start: Tensor,
    schedule: NoiseSchedule,
    levels: Sequence[float],
    config: SamplerConfig,
    fresh_noise: Callable[[], Tensor],
) -> Iterator[SamplerStep]:
    """Draw from the posterior of the next level, given the predicted clean sample.

    Source: Ho et al., Denoising diffusion probabilistic models, 2020, equation 7.
    """
    noisy, table = start, torch.tensor(levels, dtype=torch.float64)[:, None]
    alphas = schedule.alpha(table).to(start)
    variances = schedule.sigma(table).square().to(start)
    for index in range(len(levels)):
        with sampling_mode(start[..., 0].numel()):
            clean = denoise(noisy, index)
            if index + 1 < len(levels):
                ratio = alphas[index] / alphas[index + 1]
                ahead = variances[index + 1] / variances[index]
                added = 1 - ratio.square() * ahead
                mean = ratio * ahead * noisy + alphas[index + 1] * added * clean
                spread = (added * variances[index + 1]).sqrt()
                noisy = mean + spread * fresh_noise().to(start)
        yield SamplerStep(index=index, num_steps=len(levels), clean=clean)


def generator() -> PathDiffuser:
    """Make the shipped model with this sampler."""
    return PathDiffuser(models_folder() / "path-diffuser", sampler=ancestral)
