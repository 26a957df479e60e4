from dataclasses import replace

import pytest
import torch

from pd_editor.experiments.training.run_config import OwnSamplesConfig
from pd_editor.experiments.training.stage_objective import (
    initial_state_samples_loss,
    state_collisions_m,
)
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network.conditioning import (
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.network.state_encoding import encode_states
from tests.generation.initial_state.scenes import scene_batch, trained_a_little


def test_depth_is_that_of_boxes_that_overlap_and_may_not() -> None:
    scene = scene_batch(3)
    pose = scene.agent_pose.clone()
    pose[0, :3] = torch.tensor([[0.0, 0.0, 0.0], [4.0, 0.5, 0.0], [30.0, 0.0, 0.0]])
    size, kind = scene.agent_size.clone(), scene.agent_kind.clone()
    size[:], kind[:] = torch.tensor([4.6, 1.9]), 0
    scene = replace(scene, agent_pose=pose, agent_size=size, agent_kind=kind)
    states = encode_states(scene.agent_pose, scene.agent_speed)[None]
    task = sampling_conditioning(scene)
    depth = state_collisions_m(states, scene, task, 0.1)
    assert depth[0, 0, 0, 1] == depth[0, 0, 1, 0] == pytest.approx(0.7, abs=1e-3)
    assert depth.sum() == pytest.approx(1.4, abs=1e-3)
    walking = replace(scene, agent_kind=torch.full_like(kind, PEDESTRIAN))
    given = replace(task, is_given=scene.has_agent)
    assert state_collisions_m(states, walking, task, 0.1).sum() == 0
    assert state_collisions_m(states, scene, given, 0.1).sum() == 0


def test_fewer_overlaps_after_some_steps() -> None:
    torch.manual_seed(0)
    config = InitialStateConfig(width=32, num_heads=2, num_layers=1, relation_width=16)
    model, scene = trained_a_little(InitialStateDenoiser(config)), scene_batch(24)
    # Long ones, so that some overlap whatever the random numbers are.
    size = torch.tensor([12.0, 2.9]).expand_as(scene.agent_size)
    scene = replace(scene, agent_size=size, agent_kind=0 * scene.agent_kind)
    optimiser = torch.optim.Adam(model.parameters(), lr=3e-3)
    depths = []
    for _ in range(12):
        loss, parts = initial_state_samples_loss(
            model,
            scene,
            torch.Generator().manual_seed(1),
            OwnSamplesConfig(weight=1.0, num_gradient_steps=1),
        )
        optimiser.zero_grad()
        loss.backward()
        assert all(
            torch.isfinite(one.grad).all()
            for one in model.parameters()
            if one.grad is not None
        )
        optimiser.step()
        depths.append(float(parts["collision"]))
    assert depths[-1] < depths[0]
