from dataclasses import replace

import pytest
import torch

from pd_editor.diffusion.fused.folded_pose_denoiser import FoldedPoseDenoiser
from pd_editor.diffusion.initial_state.conditioning import PoseTask, drawing_task
from pd_editor.diffusion.initial_state.denoiser import PoseDenoiser
from pd_editor.diffusion.initial_state.noise import noise_scale, preconditioning
from pd_editor.diffusion.inputs.scene_batch import SceneTensors, batch_of
from tests.diffusion.initial_state.scenes import packed_scene, scene_batch, small_model

LEVELS = [1.0, 0.7, 0.3, 0.0]


def random_model(**changes: bool) -> PoseDenoiser:
    model = small_model(is_ordered=True, **changes)
    random = torch.Generator().manual_seed(3)
    for parameter in model.parameters():
        torch.nn.init.normal_(parameter, std=0.15, generator=random)
    return model


def noise(scene: SceneTensors, samples: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(1)
    shape = (samples, *scene.has_agent.shape, 5)
    return 0.7 * torch.randn(shape, generator=random)


def assert_same(
    model: PoseDenoiser, scene: SceneTensors, task: PoseTask, samples: int
) -> None:
    """Outputs of the networks themselves, which count little at low noise."""
    noisy = noise(scene, samples)
    with torch.inference_mode():
        context = model.context(scene, task)
        drawing = FoldedPoseDenoiser(model).drawing(scene, task, LEVELS, samples)
        for index, level in enumerate(LEVELS):
            levels = torch.full(noisy.shape[:2], level)
            expected = model.denoise(context, noisy, levels)
            found = drawing.denoise(noisy, index)
            factor = preconditioning(noise_scale(torch.tensor(level)))[2]
            torch.testing.assert_close(
                found / factor, expected / factor, rtol=1e-4, atol=3e-4
            )
            assert torch.equal(found[:, task.is_given], expected[:, task.is_given])


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("num_agents", [(5,), (7, 3, 1)])
@pytest.mark.parametrize("is_differential", [False, True])
@pytest.mark.parametrize("some_given", [False, True])
def test_folded_it_is_the_same_function(
    samples: int, num_agents: tuple[int, ...], is_differential: bool, some_given: bool
) -> None:
    scene = scene_batch(*num_agents)
    model = random_model(is_differential=is_differential)
    is_given = torch.arange(scene.has_agent.shape[1]) % 3 == 1
    is_given = is_given & scene.has_agent & some_given
    assert_same(model, scene, drawing_task(scene, is_given), samples)


def test_agents_that_see_nobody_or_no_road() -> None:
    packed = [packed_scene(1, 12), packed_scene(4, 3, seed=2), packed_scene(3, 40)]
    packed[0].piece_pose[:, 0] += 500.0
    scene = batch_of(packed)
    model = random_model()
    assert_same(model, scene, drawing_task(scene), 2)
    task = replace(drawing_task(scene), is_central=torch.tensor([True, False, True]))
    assert_same(model, scene, task, 2)
    alone = batch_of(packed[:1])
    assert_same(model, alone, drawing_task(alone), 1)


def test_training_goes_on_without_what_was_folded() -> None:
    scene = scene_batch(6)
    model, noisy = random_model(), noise(scene, 1)
    with torch.inference_mode():
        network = FoldedPoseDenoiser(model)
        drawing = network.drawing(scene, drawing_task(scene), LEVELS, 1)
        before = drawing.denoise(noisy, 1)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.mul_(2)
    with torch.inference_mode():
        assert torch.equal(before, drawing.denoise(noisy, 1))
