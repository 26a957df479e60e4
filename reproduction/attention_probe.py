"""Attention scores of the first stage, read out of its layers at some noise levels.

The paper's Table I: with plain attention, scores of agents over map tokens hardly vary;
differential attention prefers some tokens. Nothing is recorded unless a probe is attached.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.generation.core.attention import (
    DifferentialAttention,
    EdgeAttention,
    Mask,
)
from pd_editor.generation.core.noise_schedule import noised
from pd_editor.generation.core.sampler import sampling_mode
from pd_editor.generation.initial_state.network.conditioning import (
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateDenoiser,
    InitialStateLayer,
)
from pd_editor.generation.inputs import SceneTensors


@dataclass(frozen=True, kw_only=True)
class ScoreVariance:
    """Mean variance of the scores of a query over the keys that it may see."""

    over_map: float
    """Attention of agents to map tokens."""
    over_agents: float
    """Attention of agents to each other; NaN if no agent has two others."""


@dataclass(eq=False)
class AttentionProbe:
    """Variances of all attention scores that were computed while it was attached."""

    over_map: list[Tensor] = field(default_factory=list)
    over_agents: list[Tensor] = field(default_factory=list)

    @contextmanager
    def attached(self, model: InitialStateDenoiser) -> Iterator[None]:
        """Record each call of the attentions of a network."""
        handles = []
        for layer in model.layers:
            assert isinstance(layer, InitialStateLayer)
            for module, found in (
                (layer.map_attention, self.over_map),
                (layer.agent_attention, self.over_agents),
            ):
                hook = _recorder(found)
                handles.append(module.register_forward_pre_hook(hook))
        try:
            yield
        finally:
            for handle in handles:
                handle.remove()


def attention_variance(
    model: InitialStateDenoiser,
    scenes: Sequence[SceneTensors],
    levels: Sequence[float],
) -> list[ScoreVariance]:
    """Variances of attention scores at noise levels 0..1, over all layers and heads.

    The states of all agents of each scene are noised to each level.
    """
    random = torch.Generator().manual_seed(0)
    found: list[ScoreVariance] = []
    for level in levels:
        probe = AttentionProbe()
        with probe.attached(model):
            for scene in scenes:
                _denoise_once(model, scene, level, random)
        found.append(
            ScoreVariance(
                over_map=_mean(probe.over_map), over_agents=_mean(probe.over_agents)
            )
        )
    return found


def _denoise_once(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    level: float,
    random: torch.Generator,
) -> None:
    with sampling_mode(scene.has_agent.numel()):
        clean = model.encode_states(scene)[None]
        table = torch.full((1, scene.num_scenes), level)
        noise = torch.randn(clean.shape, generator=random)
        within_kinds = not model.config.orders_all_kinds
        task = sampling_conditioning(scene, within_kinds=within_kinds)
        context = model.encode_context(scene, task)
        model.denoise(
            noised(model.schedule, clean, noise, table[..., None, None]),
            model.encode_level(table, context),
            context,
        )


def _recorder(found: list[Tensor]):  # noqa: ANN202  (a hook of torch)
    def hook(module: nn.Module, inputs: tuple) -> None:
        if isinstance(module, DifferentialAttention):
            scores, mask = module.scores(*inputs), inputs[1].mask
        else:
            assert isinstance(module, EdgeAttention)
            (scores, _), mask = module.scores(*inputs), inputs[2]
        found.append(_variances(scores, mask))

    return hook


def _variances(scores: Float[Tensor, "*b Q K"], mask: Mask) -> Float[Tensor, "N"]:
    """Variance of each query's scores over visible keys; queries with two or more."""
    is_seen = torch.ones_like(scores)
    if mask.added is not None:
        is_seen = is_seen * torch.isfinite(mask.added)
    if mask.sees_any is not None:
        is_seen = is_seen * (mask.sees_any > 0)
    number = is_seen.sum(dim=-1)
    mean = (scores * is_seen).sum(dim=-1) / number.clamp_min(1)
    square = ((scores - mean[..., None]).square() * is_seen).sum(dim=-1)
    return (square / number.clamp_min(1))[number > 1]


def _mean(parts: Sequence[Tensor]) -> float:
    return float(torch.cat(list(parts)).mean()) if parts else float("nan")
