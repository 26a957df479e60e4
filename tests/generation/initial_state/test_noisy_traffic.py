"""Where sampling starts: noisy traffic with the moments of the training data."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.generation.initial_state.noisy_traffic import fit_moments, noisy_traffic
from pd_editor.generation.inputs import SceneTensors
from tests.generation.initial_state.scenes import packed_scene, scene_batch, small_model

SCENES = [packed_scene(30, seed=seed) for seed in range(40)]


@pytest.fixture(scope="module")
def fitted() -> InitialStateDenoiser:
    model = small_model(is_ordered=True)
    model.get_buffer("state_moments").copy_(fit_moments(model, SCENES))
    return model


def start(
    model: InitialStateDenoiser, scene: SceneTensors, task: Conditioning, num: int = 300
) -> torch.Tensor:
    """The traffic, with hardly any noise."""
    schedule = replace(model.schedule, highest=(1e-6,) * 8)
    model.schedule = schedule
    streams = RandomStreams(4, "states", range(num))
    return noisy_traffic(model, scene, task, streams)


def test_speeds_and_activities_have_the_moments_of_the_data(
    fitted: InitialStateDenoiser,
):
    speed = np.concatenate([one.agent_speed for one in SCENES])
    kind = np.concatenate([one.agent_kind for one in SCENES])
    activity = np.concatenate([one.agent_activity for one in SCENES])
    code = np.where(speed < 0.5, -0.5, np.sqrt(speed) / 2)
    scene = scene_batch(24)
    for attribute, moves in ((0, speed >= 0), (1, speed < 0.5), (2, speed >= 0.5)):
        task = sampling_conditioning(scene)
        task = replace(task, moves=torch.full_like(task.moves, attribute))
        found = start(fitted, scene, task)[:, 0]
        for index in range(5):
            mine = found[:, scene.agent_kind[0] == index, 4:].flatten(0, 1)
            true = moves & (kind == index) & (activity > 0)
            assert mine[:, 0].mean().item() == pytest.approx(
                code[true].mean(), abs=0.05
            )
            assert mine[:, 0].std().item() == pytest.approx(code[true].std(), abs=0.05)
            is_driving = (activity[true] == 3) - 0.5
            both = np.cov(code[true], is_driving)
            ours = torch.cov(mine[:, [0, 3]].T)
            np.testing.assert_allclose(ours, both, atol=0.05)


def test_places_are_those_of_lanes_in_the_square_in_the_order_of_ranks(
    fitted: InitialStateDenoiser,
):
    scene = scene_batch(9, 14)
    side = torch.tensor([62.0, 30.0])
    is_given = torch.zeros_like(scene.has_agent)
    is_given[0, 2] = True
    task = sampling_conditioning(scene, is_given, side)
    places = start(fitted, scene, task, 100)[..., :2] * POSITION_UNIT_M
    for index in range(2):
        sampled = scene.has_agent[index] & ~is_given[index]
        pieces = scene.piece_pose[index, scene.has_piece[index], :2]
        inside = pieces[(pieces.abs() <= side[index]).all(dim=-1)]
        mine = places[:, index, sampled]
        away = torch.cdist(mine, inside).amin(dim=-1)
        assert away.max() < 0.1
        # Every lane piece of the square is used.
        assert torch.cdist(inside, mine.flatten(0, 1)).amin(dim=-1).max() < 0.1
        kinds, order = scene.agent_kind[index, sampled], task.order[index, sampled]
        for kind in kinds.unique():
            ranked = order[kinds == kind].argsort()
            along = mine[:, kinds == kind, 0][:, ranked]
            assert (along.diff(dim=-1) >= -1e-3).all()


def test_without_lanes_places_are_anywhere_in_the_square(fitted: InitialStateDenoiser):
    scene = scene_batch(12)
    scene = replace(scene, has_piece=torch.zeros_like(scene.has_piece))
    task = sampling_conditioning(scene, half_side_m=torch.tensor([40.0]))
    places = start(fitted, scene, task)[:, 0, :12, :2] * POSITION_UNIT_M
    assert places.abs().max() <= 40.01
    assert places.std(dim=(0, 1)).tolist() == pytest.approx([23.1, 23.1], rel=0.05)


def test_a_sample_alone_starts_as_among_others(fitted: InitialStateDenoiser):
    scene = scene_batch(7)
    task = sampling_conditioning(scene)
    together = start(fitted, scene, task, 3)
    streams = RandomStreams(4, "states", [2])
    alone = noisy_traffic(fitted, scene, task, streams)
    torch.testing.assert_close(alone[0], together[2])


def test_few_agents_of_a_kind_have_the_moments_of_all():
    scenes = [packed_scene(30, seed=seed, kinds=2) for seed in range(20)]
    model = small_model()
    found = fit_moments(model, scenes)
    torch.testing.assert_close(found[4], found[2])
    assert not torch.allclose(found[0], found[1])
    standing, moving = found[0, CONDITIONED_NO], found[0, CONDITIONED_YES]
    assert standing[0, 0] == pytest.approx(-0.5)
    assert moving[0, 0] > 0.4


def test_without_data_the_moments_stay():
    model = small_model()
    found = fit_moments(model, [packed_scene(3)])
    torch.testing.assert_close(found, model.get_buffer("state_moments"))
