"""Critic of sampled initial states, trained beside the network that samples them."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.diffusion.core.noise_schedule import noised
from pd_editor.diffusion.initial_state.network.conditioning import Conditioning
from pd_editor.diffusion.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.diffusion.initial_state.network.state_encoding import (
    decode_activity,
    decode_states,
    encode_states,
    is_standing,
    unit_vectors,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.scene.thresholds import MOVING_MPS
from pd_editor.training.loop.train_loop import Critic
from pd_editor.training.own_samples.settings import OwnSamplesConfig

_HEAD_WIDTH: Final = 64
_HEAD_SEED: Final = 0
_BETAS: Final = (0.5, 0.99)
_WEIGHT_DECAY: Final = 1e-4
_MOST_GRADIENT: Final = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedStates:
    """Samples of B scenes beside the true states of the same agents."""

    scene: SceneTensors
    task: Conditioning
    true: Float[Tensor, "B A P"]
    sampled: Float[Tensor, "S B A P"]
    level: Float[Tensor, "S B"]
    """Level of the noise with which both are compared."""
    true_noise: Float[Tensor, "S B A P"]
    sampled_noise: Float[Tensor, "S B A P"]
    counts: Float[Tensor, "B A"]
    """1 for agents that are compared, 0 for the others."""

    def mean(self, values: Float[Tensor, "S B A"]) -> Float[Tensor, ""]:
        """Mean over compared agents; 0 without any."""
        total = (values * self.counts).sum()
        return total / (len(values) * self.counts.sum()).clamp_min(1)


class StateCritic(Critic):
    """Tells sampled states from true ones: agent by agent, from all that is around.

    A copy of the denoiser with a head on the embeddings of its agents. Both kinds of
    states are compared with noise of random levels, as details of few centimetres would
    tell them apart otherwise. Of several training processes each has its own.

    Source: Goodfellow et al., Generative adversarial nets, 2014 (the loss that does not
    saturate); Sauer et al., Fast high-resolution image synthesis with latent adversarial
    diffusion distillation, 2024 (embeddings of the denoiser, noise of random levels).
    """

    def __init__(
        self, denoiser: InitialStateDenoiser, config: OwnSamplesConfig
    ) -> None:
        super().__init__()
        width = denoiser.config.width
        self.denoiser = copy.deepcopy(denoiser)
        # Equal in all runs, so that they can be repeated.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(_HEAD_SEED)
            self.head = nn.Sequential(
                nn.Linear(width, _HEAD_WIDTH), nn.GELU(), nn.Linear(_HEAD_WIDTH, 1)
            )
        self.register_buffer("num_steps", torch.zeros((), dtype=torch.int64))
        self._embedded: Tensor | None = None
        self.denoiser.output.register_forward_pre_hook(self._keep_embedded)
        self._warmup_steps = config.critic_warmup_steps
        self.optimiser = torch.optim.AdamW(
            self.parameters(),
            lr=config.critic_learning_rate,
            betas=_BETAS,
            weight_decay=_WEIGHT_DECAY,
        )

    @property
    def is_warm(self) -> bool:
        """Whether the critic has had its steps alone, before the network learns from it."""
        return int(self.get_buffer("num_steps")) >= self._warmup_steps

    def learn(self, compared: ComparedStates) -> Float[Tensor, ""]:
        """Train for a step; returns the loss before it, 2 log 2 for a critic that guesses."""
        self.requires_grad_(True)
        with torch.enable_grad():
            loss = self._loss(compared)
            self.optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.parameters(), _MOST_GRADIENT)
            self.optimiser.step()
        self.requires_grad_(False)
        self.get_buffer("num_steps").add_(1)
        return loss.detach()

    def realism_loss(self, compared: ComparedStates) -> Float[Tensor, ""]:
        """Loss of the samples, log 2 where they are taken for true ones half the time."""
        (found,) = self._logits(compared, (compared.sampled, compared.sampled_noise))
        return compared.mean(nn.functional.softplus(-found))

    def _loss(self, compared: ComparedStates) -> Float[Tensor, ""]:
        of_true, of_sampled = self._logits(
            compared,
            (compared.true.expand(compared.sampled.shape), compared.true_noise),
            (compared.sampled.detach(), compared.sampled_noise),
        )
        softplus = nn.functional.softplus
        return compared.mean(softplus(-of_true)) + compared.mean(softplus(of_sampled))

    def _logits(
        self, compared: ComparedStates, *noised_states: tuple[Tensor, Tensor]
    ) -> Iterator[Float[Tensor, "S B A"]]:
        """Logarithm of the odds that agents are true ones, for states with their noise."""
        denoiser = self.denoiser
        level = compared.level[..., None, None]
        context = denoiser.encode_context(compared.scene, compared.task)
        encoded = denoiser.encode_level(compared.level, context)
        for states, noise in noised_states:
            noisy = noised(denoiser.schedule, states, noise, level)
            denoiser.denoise(noisy, encoded, context)
            assert self._embedded is not None
            yield self.head(self._embedded)[..., 0].transpose(0, 1).float()

    def _keep_embedded(self, _output: nn.Module, inputs: tuple[Any, ...]) -> None:
        self._embedded = inputs[0]


def as_decoded(codes: Float[Tensor, "*b P"]) -> Float[Tensor, "*b P"]:
    """Codes of what they are decoded to, with the gradient of the codes themselves.

    Headings are unit vectors, stationary agents and activities have their exact codes: by
    these alone samples could be told from true states.
    """
    states = decode_states(codes)
    heading = torch.atan2(states[..., 3], states[..., 2])[..., None]
    # Rounding must not make the slowest moving agents stationary.
    speed = torch.where(is_standing(codes), 0.0, states[..., 4].clamp_min(MOVING_MPS))
    exact = encode_states(
        torch.cat([states[..., :2], heading], dim=-1),
        speed,
        decode_activity(codes) if codes.shape[-1] > states.shape[-1] else None,
    )
    others = codes[..., 4:] + (exact - codes)[..., 4:].detach()
    return torch.cat([codes[..., :2], unit_vectors(codes[..., 2:4]), others], dim=-1)
