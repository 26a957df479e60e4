import pytest
import torch

from pd_editor.diffusion.fused.folded_denoiser import FoldedDenoiser
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.trajectory.denoiser import TrajectoryDenoiser
from tests.diffusion.trajectory.scenes import scene_batch, small_model

LEVELS = [1.0, 0.6, 0.2]


def in_double(**changes: object) -> tuple[TrajectoryDenoiser, SceneTensors]:
    model = small_model(0, **changes).double()
    for parameter in model.parameters():
        torch.nn.init.normal_(parameter, std=0.2)
    return model, scene_batch(7, 3, 1).to("cpu", torch.float64)


def noise(scene: SceneTensors, samples: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(1)
    shape = (samples, *scene.has_agent.shape, 10)
    return torch.randn(shape, generator=random, dtype=torch.float64)


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("prediction", ["clean", "velocity", "noise"])
@pytest.mark.parametrize("sees_way_points", [False, True])
def test_folded_it_is_the_same_function(
    samples: int, prediction: str, sees_way_points: bool
) -> None:
    model, scene = in_double(prediction=prediction, sees_way_points=sees_way_points)
    noisy = noise(scene, samples)
    some = torch.arange(scene.has_agent.shape[1]) % 3 == 1
    with torch.inference_mode():
        context = model.context(scene)
        for is_given in (torch.zeros_like(scene.has_agent), some & scene.has_agent):
            network = FoldedDenoiser(model)
            drawing = network.drawing(network.context(scene), is_given, LEVELS, samples)
            for index, level in enumerate(LEVELS):
                each = level * (~is_given).to(noisy)
                expected = model.denoise(context, noisy, each.expand(noisy.shape[:-1]))
                found = drawing.denoise(noisy, index)
                assert torch.allclose(found, expected, rtol=1e-9, atol=1e-9)
                assert torch.equal(found[:, is_given], noisy[:, is_given])


def test_blocks_that_were_folded_do_not_follow_a_training() -> None:
    model, scene = in_double()
    noisy = noise(scene, 1)
    network = FoldedDenoiser(model)
    is_given = torch.zeros_like(scene.has_agent)
    with torch.inference_mode():
        context = network.context(scene)
        before = network.drawing(context, is_given, LEVELS, 1).denoise(noisy, 0)
    with torch.no_grad():
        for block in model.blocks:
            for parameter in block.parameters():
                parameter.mul_(2)
    with torch.inference_mode():
        after = network.drawing(context, is_given, LEVELS, 1).denoise(noisy, 0)
        assert torch.equal(before, after)
