import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.diffusion.initial_state.network.conditioning import sampling_conditioning
from pd_editor.diffusion.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.diffusion.initial_state.network.state_encoding import (
    decode_activity,
    decode_states,
)
from pd_editor.training.own_samples.initial_states import initial_state_samples_loss
from pd_editor.training.own_samples.settings import OwnSamplesConfig
from pd_editor.training.own_samples.state_critic import (
    ComparedStates,
    StateCritic,
    as_decoded,
)
from tests.diffusion.initial_state.scenes import scene_batch, trained_a_little

SMALL = InitialStateConfig(width=32, num_heads=2, num_layers=1, relation_width=16)
CONFIG = OwnSamplesConfig(
    weight=1.0,
    collision=0.0,
    realism=1.0,
    num_gradient_steps=1,
    critic_warmup_steps=2,
    critic_learning_rate=3e-3,
)
GUESSES = 2 * math.log(2)


@pytest.fixture
def model():
    torch.manual_seed(0)
    return trained_a_little(InitialStateDenoiser(SMALL))


def compared(model, *, turned_rad: float) -> ComparedStates:
    """True states beside the same ones with another heading."""
    scene = scene_batch(9)
    true = model.encode_states(scene)
    pose = scene.agent_pose.clone()
    pose[..., 2] += turned_rad
    sampled = model.encode_states(replace(scene, agent_pose=pose))[None]
    random = torch.Generator().manual_seed(0)
    return ComparedStates(
        scene=scene,
        task=sampling_conditioning(scene),
        true=true,
        sampled=sampled,
        level=0.2 * torch.rand(1, scene.num_scenes, generator=random),
        true_noise=torch.randn(sampled.shape, generator=random),
        sampled_noise=torch.randn(sampled.shape, generator=random),
        counts=scene.has_agent.to(true),
    )


def test_states_that_differ_are_told_apart_and_equal_ones_are_not(model) -> None:
    last = {}
    for turned in (0.0, 0.8):
        critic = StateCritic(model, CONFIG)
        pairs = compared(model, turned_rad=turned)
        random = torch.Generator().manual_seed(1)
        for _ in range(40):
            # Noise that is new in each step cannot be learned by heart.
            noise = torch.randn((2, *pairs.sampled.shape), generator=random)
            pairs = replace(pairs, true_noise=noise[0], sampled_noise=noise[1])
            last[turned] = float(critic.learn(pairs))
    assert last[0.0] == pytest.approx(GUESSES, abs=0.15)
    assert last[0.8] < 0.75 * GUESSES


def test_samples_get_the_gradient_and_the_critic_none(model) -> None:
    critic = StateCritic(model, CONFIG)
    pairs = compared(model, turned_rad=0.5)
    critic.learn(pairs)
    weights = [one.clone() for one in critic.parameters()]
    sampled = pairs.sampled.clone().requires_grad_()
    critic.optimiser.zero_grad()
    critic.realism_loss(replace(pairs, sampled=sampled)).backward()
    assert sampled.grad is not None
    assert sampled.grad[..., 2:4].abs().sum() > 0
    absent = ~pairs.scene.has_agent
    assert not sampled.grad[0][absent].any()
    assert all(one.grad is None for one in critic.parameters())
    assert all(
        torch.equal(one, two)
        for one, two in zip(weights, critic.parameters(), strict=True)
    )


def test_the_network_learns_from_a_warm_critic_only_and_validation_trains_none(
    model,
) -> None:
    critic, scene = StateCritic(model, CONFIG), scene_batch(9)
    found = []
    for step in range(3):
        random = torch.Generator().manual_seed(step)
        loss, parts = initial_state_samples_loss(model, scene, random, CONFIG, critic)
        found.append((set(parts), loss.requires_grad))
    assert found == [
        ({"critic"}, False),
        ({"critic"}, False),
        ({"critic", "realism"}, True),
    ]
    with torch.no_grad():
        random = torch.Generator().manual_seed(3)
        _, parts = initial_state_samples_loss(model, scene, random, CONFIG, critic)
    assert set(parts) == {"realism"}
    assert int(critic.get_buffer("num_steps")) == 3


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31))
def test_codes_of_decoded_states_decode_to_the_same_and_pass_the_gradient(seed) -> None:
    random = torch.Generator().manual_seed(seed)
    codes = torch.randn((3, 7, 8), generator=random).requires_grad_()
    exact = as_decoded(codes)
    torch.testing.assert_close(decode_states(exact), decode_states(codes))
    assert torch.equal(decode_activity(exact), decode_activity(codes))
    torch.testing.assert_close(as_decoded(exact), exact)
    torch.testing.assert_close(exact[..., 2:4].norm(dim=-1), torch.ones(3, 7))
    gradient = torch.autograd.grad(exact[..., 4:].sum(), codes)[0]
    assert torch.equal(gradient[..., 4:], torch.ones_like(codes[..., 4:]))
