from dataclasses import replace

import pytest
import torch

from pd_editor.experiments.training.run_config import OwnSamplesConfig
from pd_editor.experiments.training.stage_objective import (
    collision_depth_m,
    energy_score_m,
    off_road_m,
    trajectory_samples_loss,
)
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.features import Neighbors
from tests.generation.trajectory.scenes import arc_basis, scene_batch, small_model

DECODER = TrajectoryDecoder(arc_basis(), 59)
ALL = OwnSamplesConfig(weight=1.0, collision=1.0, road=1.0, truth=1.0)


def oncoming(gap_m: float = 10.0, aside_m: float = 0.0, kind: int = 0) -> SceneTensors:
    """A car at 10 m/s, and a standing one ahead of it."""
    return replace(
        scene_batch(2),
        agent_pose=torch.tensor([[[0.0, 0.0, 0.5], [0.0, 0.0, 0.5]]])
        + torch.tensor([[[0.0, 0.0, 0.0], turned(gap_m, aside_m)]]),
        agent_speed=torch.tensor([[10.0, 0.0]]),
        agent_size=torch.tensor([[[4.6, 2.0], [4.6, 2.0]]]),
        agent_kind=torch.full((1, 2), kind),
        near_agents=torch.tensor([[[1] + [-1] * 7, [0] + [-1] * 7]]),
    )


def turned(ahead_m: float, aside_m: float) -> list[float]:
    place = complex(ahead_m, aside_m) * complex(*torch.tensor([0.5]).cos().tolist(), 0)
    place += complex(ahead_m, aside_m) * 1j * float(torch.tensor(0.5).sin())
    return [place.real, place.imag, 0.0]


def depth_of(scene: SceneTensors, latent: torch.Tensor) -> torch.Tensor:
    return collision_depth_m(DECODER, latent, Neighbors.of(scene, 8), scene, 0.1)


def constant_velocity(scene: SceneTensors) -> torch.Tensor:
    """The latents of constant velocity."""
    return DECODER.still(torch.zeros_like(scene.agent_speed))[None]


def test_agents_that_meet_collide_as_deep_as_at_their_first_contact() -> None:
    scene = oncoming()
    depth = depth_of(scene, constant_velocity(scene))
    # The gap of 5.4 m is closed after 0.54 s, and 7 m are driven 0.7 s on.
    assert depth[0, 0, :, 0].tolist() == pytest.approx([1.7, 1.7], abs=0.01)
    assert (depth[..., 1:] == 0).all()
    passing = oncoming(aside_m=2.3)
    assert (depth_of(passing, constant_velocity(passing)) == 0).all()


@pytest.mark.parametrize("scene", [oncoming(kind=PEDESTRIAN), oncoming(gap_m=3.0)])
def test_walkers_and_boxes_that_overlap_now_do_not_count(scene: SceneTensors) -> None:
    assert (depth_of(scene, constant_velocity(scene)) == 0).all()


def test_less_depth_is_braking() -> None:
    scene = oncoming(gap_m=30.0, aside_m=0.4)
    latent = constant_velocity(scene).requires_grad_(True)
    depth = depth_of(scene, latent)
    depth.sum().backward()
    assert latent.grad is not None
    changed = (latent - 1e-4 * latent.grad).detach()
    assert depth_of(scene, changed).sum() < depth.sum()
    step = torch.tensor([20])
    before, after = (
        DECODER.points(one, scene.agent_speed, step)[0].detach()[0, 0, 0]
        for one in (latent, changed)
    )
    assert after < before


def test_off_the_road_is_right_of_the_boundary() -> None:
    scene = oncoming()
    pose = torch.zeros_like(scene.boundary_pose)
    # The road lies to the left of a line along the way of the agent, 3 m to its right.
    pose[..., 2] = 0.5
    pose[..., 0] = 3.0 * float(torch.tensor(0.5).sin())
    pose[..., 1] = -3.0 * float(torch.tensor(0.5).cos())
    shape = torch.full_like(scene.boundary_shape, 20.0)
    scene = replace(scene, boundary_pose=pose, boundary_shape=shape)
    straight = constant_velocity(scene)
    assert (off_road_m(DECODER, straight, scene) == 0).all()
    to_the_right = straight.clone()
    aside = DECODER.points(straight, scene.agent_speed, torch.tensor([58]))[1]
    to_the_right[..., 5] -= 1.0
    moved = DECODER.points(to_the_right, scene.agent_speed, torch.tensor([58]))[1]
    sign = 1.0 if (moved < aside).all() else -1.0
    to_the_right[..., 5] = straight[..., 5] - sign * 0.5
    off = off_road_m(DECODER, to_the_right, scene)
    assert (off > 0).all() or (off[0, 0, 0] > 0)
    no_boundary = replace(scene, has_boundary=torch.zeros_like(scene.has_boundary))
    assert (off_road_m(DECODER, to_the_right, no_boundary) == 0).all()


def test_the_energy_score_is_least_for_the_true_distribution() -> None:
    random = torch.Generator().manual_seed(0)
    true = torch.randn(1, 4000, 10, generator=random)
    counts = torch.ones(1, 4000).bool()
    noise = torch.randn(2, 1, 4000, 10, generator=random)
    scores = {
        width: float(energy_score_m(DECODER, width * noise, true, counts))
        for width in (0.0, 0.5, 1.0, 2.0)
    }
    assert min(scores, key=lambda width: scores[width]) == 1.0
    none = torch.zeros_like(counts)
    assert float(energy_score_m(DECODER, noise, true, none)) == 0.0


def test_gradients_flow_through_the_last_steps() -> None:
    model, scene = small_model(), scene_batch(6, 7)
    found = []
    for steps in (1, 2):
        model.zero_grad()
        config = replace(ALL, num_gradient_steps=steps)
        loss, parts = trajectory_samples_loss(
            model, scene, torch.Generator().manual_seed(0), config
        )
        loss.backward()
        assert parts.keys() == {"collision", "road", "truth"}
        gradient = model.noisy_in.weight.grad
        assert gradient is not None
        assert torch.isfinite(gradient).all()
        assert (gradient != 0).any()
        found.append((float(loss.detach()), gradient.clone()))
    # The samples are the same, however many steps are differentiated.
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-5)
    assert not torch.allclose(found[0][1], found[1][1])


def test_fewer_collisions_after_some_steps() -> None:
    model, scene = small_model(), scene_batch(12)
    optimiser = torch.optim.Adam(model.parameters(), lr=3e-3)
    depths = []
    for _ in range(25):
        loss, parts = trajectory_samples_loss(
            model,
            scene,
            torch.Generator().manual_seed(0),
            OwnSamplesConfig(weight=1.0),
        )
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        depths.append(float(parts["collision"]))
    assert depths[-1] < 0.8 * depths[0]
