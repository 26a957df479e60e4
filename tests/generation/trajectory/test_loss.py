from dataclasses import replace

import pytest
import torch

from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.loss import (
    TrajectoryLossConfig,
    overlap_depth_m,
    starts,
    trajectory_loss,
)
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.network.features import Neighbors
from pd_editor.generation.trajectory.sampler import TrajectoryNoise, sample_trajectories
from tests.generation.trajectory.scenes import scene_batch, small_model


def loss_of(
    model: TrajectoryDenoiser, scene: SceneTensors, seed: int = 0, **changes: float
) -> dict[str, float]:
    config = TrajectoryLossConfig(**changes)  # type: ignore[arg-type]
    random = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        loss, parts = trajectory_loss(model, scene, random, config)
    return {"loss": float(loss), **{name: float(one) for name, one in parts.items()}}


def test_agents_without_a_future_are_context_but_not_learned() -> None:
    scene, model = scene_batch(6), small_model()
    assert not scene.has_future[0, 5]
    strange = replace(scene, future=scene.future.clone())
    strange.future[0, 5] = 100.0
    assert loss_of(model, strange, given_scenes=0.0) == loss_of(
        model, scene, given_scenes=0.0
    )


def test_padding_adds_nothing() -> None:
    model, scene = small_model(), scene_batch(5, 12)
    padded = ~scene.has_agent
    assert padded.any()
    changes = {}
    for name in ("future", "agent_pose", "agent_speed", "candidates"):
        values = getattr(scene, name).clone()
        values[padded] = 7.0
        changes[name] = values
    expected, found = (
        loss_of(model, one, given_scenes=0.0, overlap_weight=1.0)
        for one in (scene, replace(scene, **changes))
    )
    assert found == pytest.approx(expected, rel=1e-5)


def test_scenes_without_futures_teach_nothing() -> None:
    model, unknown = small_model(), scene_batch(3)
    unknown = replace(unknown, has_future=torch.zeros_like(unknown.has_future))
    assert loss_of(model, unknown)["loss"] == 0.0


def test_given_agents_leave_the_others_to_be_learned() -> None:
    scene, model = scene_batch(5), small_model()
    values = loss_of(model, scene, given_scenes=1.0)
    assert 0 < values["loss"] < 1e3


def test_standing_agents_that_leave_have_started() -> None:
    scene, model = scene_batch(4), small_model()
    speed = torch.tensor([[0.0, 0.0, 0.4, 0.0]])
    stays = model.decoder.still(speed)
    leaves = stays.clone()
    leaves[..., 0] += 2.0
    x, _ = model.decoder.points(leaves, speed, torch.tensor([58]))
    assert (x.abs() > 2).all()
    scene = replace(scene, agent_speed=speed, has_future=torch.ones(1, 4).bool())
    scene.has_future[0, 3] = False
    assert starts(model, replace(scene, future=leaves)).tolist() == [
        [True, True, False, False]
    ]
    assert not starts(model, replace(scene, future=stays)).any()


def test_who_starts_counts_more() -> None:
    scene, model = scene_batch(4), small_model()
    speed = torch.zeros(1, 4)
    stays = replace(scene, agent_speed=speed, future=model.decoder.still(speed))
    leaves = replace(stays, future=stays.future.clone())
    leaves.future[..., 0] += 2.0
    latent = {
        (name, weight): loss_of(model, one, starting_weight=weight)["latent"]
        for name, one in (("stays", stays), ("leaves", leaves))
        for weight in (1.0, 3.0)
    }
    assert latent["stays", 3.0] == latent["stays", 1.0]
    assert latent["leaves", 3.0] == pytest.approx(3 * latent["leaves", 1.0])


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_gradients_reach_every_weight(weight: float) -> None:
    scene, model = scene_batch(6, 7), small_model()
    config = TrajectoryLossConfig(overlap_weight=weight)
    loss, _ = trajectory_loss(model, scene, torch.Generator().manual_seed(0), config)
    loss.backward()
    still = [name for name, one in model.named_parameters() if one.grad is None]
    assert not still
    assert all(torch.isfinite(one.grad).all() for one in model.parameters())  # type: ignore[union-attr]


def test_overlap_is_that_of_boxes_side_by_side_and_symmetric() -> None:
    scene = scene_batch(2)
    pose = torch.tensor([[[0.0, 0.0, 0.0], [10.0, 1.0, torch.pi]]])
    scene = replace(
        scene,
        agent_pose=pose,
        agent_speed=torch.tensor([[10.0, 0.0]]),
        agent_size=torch.tensor([[[4.6, 2.0], [4.6, 2.0]]]),
        near_agents=torch.tensor([[[1] + [-1] * 7, [0] + [-1] * 7]]),
    )
    model = small_model()
    stays = model.decoder.still(scene.agent_speed)[None]
    meets = torch.zeros_like(stays)
    meets[:, :, 1] = stays[:, :, 1]
    neighbors = Neighbors.of(scene, 8)
    apart = overlap_depth_m(model.decoder, stays, neighbors, scene)
    together = overlap_depth_m(model.decoder, meets, neighbors, scene)
    assert (apart == 0).all()
    # Discs of 1 m radius on axes 1 m apart reach 1 m into each other.
    assert torch.allclose(together[..., 0], torch.tensor(1.0), atol=0.15)
    assert (together[..., 1:] == 0).all()


def test_the_activity_of_some_agents_is_hidden() -> None:
    scene, model = scene_batch(6), small_model()
    torch.nn.init.normal_(model.activity_in.weight)
    blind = replace(scene, agent_activity=torch.zeros_like(scene.agent_activity))
    assert scene.agent_activity.any()

    def hidden(scenes: float, agents: float) -> dict[str, float]:
        return loss_of(model, scene, unknown_scenes=scenes, unknown_agents=agents)

    unknown, known = loss_of(model, blind), hidden(0.0, 0.0)
    assert hidden(1.0, 0.0) == hidden(0.0, 1.0) == unknown
    assert known["loss"] != unknown["loss"]


@pytest.mark.slow
def test_a_network_learns_one_scene_by_heart() -> None:
    scene, model = scene_batch(5), small_model(width=64)
    model.train()
    config = TrajectoryLossConfig(overlap_weight=0.0, given_scenes=0.0)
    random = torch.Generator().manual_seed(0)
    optimizer = torch.optim.Adam(model.parameters(), 5e-3)
    first = 0.0
    for step in range(400):
        loss, _ = trajectory_loss(model, scene, random, config)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        first = float(loss.detach()) if step == 0 else first
    model.eval()
    assert loss_of(model, scene)["loss"] < 0.15 * first
    noise = TrajectoryNoise(samples=range(4), seed=0)
    *_, last = sample_trajectories(model, scene, noise)
    gap = (last.clean - scene.future)[:, scene.has_future]
    assert gap.abs().mean() < 0.1
