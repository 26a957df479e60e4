"""How much signal and noise there is at each noise level from 0 to 1.

Variance preserving: x = alpha * clean + sigma * noise, alpha^2 + sigma^2 = 1. At
level 1 nothing of the signal is left (zero terminal SNR, Lin et al. 2024), so that
sampling starts from what training has seen there.
"""

import math
from dataclasses import dataclass
from typing import Final, Literal, assert_never

import torch
from jaxtyping import Float
from torch import Tensor

ScheduleKind = Literal["cosine", "linear"]
Prediction = Literal["clean", "velocity", "noise"]

_BETA_FIRST: Final = 0.1
_BETA_LAST: Final = 20.0
_LEAST_ALPHA: Final = 1e-3
"""Noise alone says nothing of the signal at level 1; the signal there is cut off."""


@dataclass(frozen=True, kw_only=True)
class NoiseSchedule:
    """Signal and noise amplitudes, and what a network's output stands for.

    ``linear`` has linearly growing betas (DDPM, in continuous time), shifted to zero
    terminal SNR.
    """

    kind: ScheduleKind = "cosine"
    prediction: Prediction = "clean"

    def alpha(self, level: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Amplitude of the signal: 1 at level 0, 0 at level 1."""
        match self.kind:
            case "cosine":
                # sin of the complement: exactly 0 at level 1, which cos is not.
                return torch.sin(0.5 * math.pi * (1 - level))
            case "linear":
                last = _vp_alpha(torch.ones_like(level))
                return (_vp_alpha(level) - last) / (1 - last)
            case _:
                assert_never(self.kind)

    def sigma(self, level: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Amplitude of the noise: 0 at level 0, 1 at level 1."""
        match self.kind:
            case "cosine":
                return torch.sin(0.5 * math.pi * level)
            case "linear":
                return (1 - self.alpha(level).square()).clamp_min(0).sqrt()
            case _:
                assert_never(self.kind)

    def noised(
        self,
        clean: Float[Tensor, "..."],
        noise: Float[Tensor, "..."],
        level: Float[Tensor, "..."],
    ) -> Float[Tensor, "..."]:
        """What ``clean`` has become at ``level``, which is broadcast against it."""
        return self.alpha(level) * clean + self.sigma(level) * noise

    def clean_of(
        self,
        output: Float[Tensor, "..."],
        noisy: Float[Tensor, "..."],
        level: Float[Tensor, "..."],
    ) -> Float[Tensor, "..."]:
        """The clean sample that a network's output stands for."""
        match self.prediction:
            case "clean":
                return output
            case "velocity":
                return self.alpha(level) * noisy - self.sigma(level) * output
            case "noise":
                alpha = self.alpha(level).clamp_min(_LEAST_ALPHA)
                return (noisy - self.sigma(level) * output) / alpha
            case _:
                assert_never(self.prediction)


def _vp_alpha(level: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    spent = _BETA_FIRST * level + 0.5 * (_BETA_LAST - _BETA_FIRST) * level.square()
    return torch.exp(-0.5 * spent)
