"""Noise schedules: amplitudes of signal and noise at each noise level from 0 to 1.

A noisy sample is alpha * clean + sigma * noise. Levels have a last axis of length one,
along which amplitudes may differ between the parts of a state.
"""

import functools
import math
from dataclasses import dataclass
from typing import Final, Literal, Protocol, assert_never, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.generation.core.devices import constant

ScheduleKind = Literal["cosine", "betas"]
StateScheduleKind = Literal["exploding", "betas"]
Prediction = Literal["clean", "velocity", "noise"]
StatePrediction = Literal["preconditioned", "noise"]

_PAPER_BETAS: Final = (1e-4, 0.05)
_PAPER_STEPS: Final = 100
_LEAST_ALPHA: Final = 1e-3
"""Lower bound of alpha in divisions: at level 1 there is no signal."""


@runtime_checkable
class NoiseSchedule(Protocol):
    """Interface of noise schedules for samplers and losses."""

    def alpha(self, level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b #P"]:
        """Amplitude of the signal."""
        ...

    def sigma(self, level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b #P"]:
        """Standard deviation of the noise."""
        ...


def noised(
    schedule: NoiseSchedule,
    clean: Float[Tensor, "*#b P"],
    noise: Float[Tensor, "*#b P"],
    level: Float[Tensor, "*#b 1"],
) -> Float[Tensor, "*b P"]:
    """Add noise of some level to clean samples."""
    return schedule.alpha(level) * clean + schedule.sigma(level) * noise


@dataclass(frozen=True, kw_only=True)
class VariancePreserving:
    """Schedule with alpha^2 + sigma^2 = 1, and the parametrisation of the network.

    At level 1 there is no signal (zero terminal SNR, Lin et al. 2024), so that sampling
    starts from the distribution of the training. ``betas`` is the paper's schedule of 100 steps, which keeps a signal of 0.28 at level 1.
    """

    kind: ScheduleKind = "cosine"
    prediction: Prediction = "clean"

    def alpha(self, level: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Amplitude of the signal: 1 at level 0, 0 at level 1."""
        match self.kind:
            case "cosine":
                # sin of the complement: exactly 0 at level 1, which cos is not.
                return torch.sin(0.5 * math.pi * (1 - level))
            case "betas":
                return _log_alpha(level * _PAPER_STEPS).exp()
            case _:
                assert_never(self.kind)

    def sigma(self, level: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Amplitude of the noise: 0 at level 0, 1 at level 1."""
        match self.kind:
            case "cosine":
                return torch.sin(0.5 * math.pi * level)
            case "betas":
                return _noise_of(_log_alpha(level * _PAPER_STEPS))
            case _:
                assert_never(self.kind)

    def clean_of(
        self,
        output: Float[Tensor, "..."],
        noisy: Float[Tensor, "..."],
        level: Float[Tensor, "..."],
    ) -> Float[Tensor, "..."]:
        """Predicted clean sample of a network's output."""
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


@dataclass(frozen=True)
class VarianceExploding:
    """Schedule with constant signal and exponentially increasing noise for each part.

    Each step of a sampler resolves the next smaller scale.
    """

    lowest: tuple[float, ...]
    """Standard deviation of each part at level 0."""
    highest: tuple[float, ...]
    """Standard deviation of each part at level 1."""

    def alpha(self, level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b 1"]:
        """Amplitude of the signal: 1 at all levels."""
        return torch.ones_like(level)

    def sigma(self, level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b P"]:
        """Standard deviation of the noise; 0 at negative levels."""
        low = constant([math.log(one) for one in self.lowest], level)
        high = constant([math.log(one) for one in self.highest], level)
        return torch.where(level < 0, 0.0, (low + (high - low) * level).exp())


@dataclass(frozen=True)
class DiffusionSteps:
    """The paper's forward process of 100 steps, for all parts alike.

    Level 0 is the first step and level 1 the last; at negative levels there is no noise.
    """

    def alpha(self, level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b 1"]:
        """Amplitude of the signal: 0.28 at level 1."""
        return self._log_alpha(level).exp()

    def sigma(self, level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b 1"]:
        """Standard deviation of the noise; 0 at negative levels."""
        return _noise_of(self._log_alpha(level))

    @staticmethod
    def _log_alpha(level: Float[Tensor, "*b 1"]) -> Float[Tensor, "*b 1"]:
        return _log_alpha(torch.where(level < 0, 0.0, 1 + (_PAPER_STEPS - 1) * level))


def relative_noise(
    schedule: NoiseSchedule, level: Float[Tensor, "*b 1"]
) -> Float[Tensor, "*b #P"]:
    """Standard deviation of the noise on a noisy sample that is scaled to signal 1."""
    return schedule.sigma(level) / schedule.alpha(level)


def output_factors(
    prediction: StatePrediction,
    sigma: Float[Tensor, "*b #P"],
    spread: Float[Tensor, "P"],
) -> tuple[Float[Tensor, "*b P"], Float[Tensor, "*b P"], Float[Tensor, "*b P"]]:
    """Factors of the input, of the skipped input and of the network's output.

    The clean sample is ``skip * noisy + out * output`` for noisy samples of signal 1.
    The prediction ``noise`` is the noise, of either sign.
    """
    factor_in, skip, out = preconditioning(sigma, spread)
    if prediction == "noise":
        return factor_in, torch.ones_like(skip), sigma.expand_as(out)
    return factor_in, skip, out


def preconditioning(
    sigma: Float[Tensor, "*b #P"], spread: Float[Tensor, "P"]
) -> tuple[Float[Tensor, "*b P"], Float[Tensor, "*b P"], Float[Tensor, "*b P"]]:
    """Factors of the input, of the skipped input and of the network's output.

    With them, input and target of the network are of unit size at each level. Source:
    Karras et al., Elucidating the design space of diffusion models, 2022.
    """
    total = sigma.square() + spread.square()
    return total.rsqrt(), spread.square() / total, sigma * spread * total.rsqrt()


def even_levels(num_steps: int) -> list[float]:
    """Evenly spaced levels of the steps from 1 down; the level after the last is 0."""
    assert num_steps >= 1, "a sample takes at least one step"
    return [(num_steps - index) / num_steps for index in range(num_steps)]


def centered_levels(num_steps: int, emphasis: float) -> list[float]:
    """Levels of the steps from 1 to 0, denser in the middle."""
    assert num_steps >= 1, "a sample takes at least one step"
    even = torch.linspace(1, 0, num_steps, dtype=torch.float64, device="cpu")
    # Rounded, so that the last one is 0.
    return [round(level, 12) for level in centered(even, emphasis).tolist()]


def centered(even: Float[Tensor, "*b"], emphasis: float) -> Float[Tensor, "*b"]:
    """Concentrate levels 0..1 in the middle, by the factor 1 / (1 - emphasis)."""
    return even + emphasis * (2 * math.pi * even).sin() / (2 * math.pi)


@functools.lru_cache
def _paper_table(device: torch.device) -> Float[Tensor, "T"]:
    """Logarithm of the signal's amplitude after 0 to 100 steps."""
    with torch.inference_mode(mode=False):
        betas = torch.linspace(*_PAPER_BETAS, _PAPER_STEPS, dtype=torch.float64)
        alphas = 0.5 * torch.log1p(-betas).cumsum(dim=0)
        return nn.functional.pad(alphas, (1, 0)).to(device)


def _log_alpha(step: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Logarithm of the signal's amplitude after a number of the paper's steps."""
    table = _paper_table(step.device)
    below = step.floor().clamp(0, _PAPER_STEPS - 1)
    first, second = table[below.long()], table[below.long() + 1]
    return torch.lerp(first, second, (step - below).double()).to(step)


def _noise_of(log_alpha: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Amplitude of the noise beside a signal, of total variance 1."""
    return (-torch.expm1(2 * log_alpha)).sqrt()
