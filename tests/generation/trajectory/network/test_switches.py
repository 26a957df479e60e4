"""Each switch of the second stage changes what it names, and nothing else."""

from dataclasses import replace

import pytest
import torch

from pd_editor.generation.core.noise_schedule import VariancePreserving
from pd_editor.generation.trajectory.loss import TrajectoryLossConfig, trajectory_loss
from pd_editor.generation.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from tests.generation.trajectory.scenes import arc_basis, scene_batch

SMALL = TrajectoryConfig(width=32, num_heads=2, num_blocks=2, edge_width=16)
VD = replace(
    SMALL,
    sees_candidates=False,
    sees_attributes=False,
    sees_activity=False,
    sees_way_points=False,
    sees_gaps=False,
)


def made(config: TrajectoryConfig) -> TrajectoryDenoiser:
    torch.manual_seed(0)
    model = TrajectoryDenoiser(config, arc_basis())
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    return model.eval()


def outputs(model, scene):
    noisy = torch.randn(
        2, *scene.future.shape, generator=torch.Generator().manual_seed(0)
    )
    with torch.no_grad():
        level = model.encode_level(torch.full((1, 1, 1), 0.5))
        return model.denoise(noisy, level, model.encode_context(scene))


def changed(scene):
    """Scenes in which one input differs."""
    fewer = scene.has_candidate.clone()
    fewer[..., ::2] = False
    return {
        "candidates": replace(scene, candidates=scene.candidates + 0.5),
        "their number": replace(scene, has_candidate=fewer),
        "none": replace(scene, has_candidate=torch.zeros_like(fewer)),
        "kinds": replace(scene, agent_kind=(scene.agent_kind + 1) % 4),
        "sizes": replace(scene, agent_size=scene.agent_size + 1),
        "speeds": replace(scene, agent_speed=scene.agent_speed + 4),
        "map": replace(scene, piece_shape=scene.piece_shape + 1),
        "poses": replace(scene, agent_pose=scene.agent_pose + 1),
    }


@pytest.mark.parametrize(
    ("config", "unseen"),
    [
        (SMALL, set()),
        (replace(SMALL, sees_candidates=False), {"candidates", "their number", "none"}),
        (VD, {"candidates", "their number", "none", "kinds", "sizes", "speeds"}),
    ],
)
def test_a_network_sees_what_its_switches_say(config, unseen):
    scene, model = scene_batch(5, 9), made(config)
    before = outputs(model, scene)
    for name, other in changed(scene).items():
        same = torch.equal(outputs(model, other), before)
        assert same is (name in unseen), name


def test_without_candidates_the_network_is_of_the_same_size():
    number = [
        sum(one.numel() for one in made(config).parameters())
        for config in (SMALL, replace(SMALL, sees_candidates=False))
    ]
    assert number[0] == number[1]


def test_the_schedule_of_the_paper():
    schedule = VariancePreserving(kind="betas", prediction="noise")
    betas = torch.linspace(1e-4, 0.05, 100, dtype=torch.float64)
    level = torch.tensor([0.0, 0.01, 0.5, 1.0])
    expected = [1.0, *((1 - betas).cumprod(0).sqrt()[[0, 49, 99]].tolist())]
    torch.testing.assert_close(
        schedule.alpha(level), torch.tensor(expected), atol=1e-6, rtol=1e-5
    )
    assert schedule.alpha(torch.ones(1)).item() == pytest.approx(0.2797, abs=1e-3)
    total = schedule.alpha(level).square() + schedule.sigma(level).square()
    torch.testing.assert_close(total, torch.ones(4))


def test_the_paper_s_loss_is_the_error_of_the_noise():
    config = replace(SMALL, schedule="betas", prediction="noise")
    model = made(config)
    with torch.no_grad():
        for block in model.blocks:
            for parameter in block.output[1].parameters():
                parameter.zero_()
    settings = TrajectoryLossConfig(
        counted_error="noise",
        given_scenes=0.0,
        metre_share=0.0,
        early_prediction_weight=0.0,
        overlap_weight=0.0,
        num_levels=64,
    )
    loss, parts = trajectory_loss(
        model, scene_batch(*[9] * 10), torch.Generator().manual_seed(0), settings
    )
    # An output of 0 is wrong by the noise, whose variance is 1.
    loss = loss.detach()
    assert float(loss) == pytest.approx(1.0, rel=0.1)
    assert float(parts["latent"]) == pytest.approx(float(loss))
