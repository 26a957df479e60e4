from dataclasses import fields, replace

import pytest
import torch

from pd_editor.experiments.training.stage_objective import start_from
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.network.features import Neighbors
from tests.generation.trajectory.scenes import PLAIN, scene_batch, small_model


def denoised(
    model: TrajectoryDenoiser,
    scene: SceneTensors,
    noisy: torch.Tensor,
    level: float | torch.Tensor = 0.6,
) -> torch.Tensor:
    each = torch.as_tensor(level).to(noisy).expand(noisy.shape[:-1])
    with torch.inference_mode():
        context = model.encode_context(scene)
        return model.denoise(noisy, model.encode_level(each), context)


def noise(scene: SceneTensors, samples: int = 2) -> torch.Tensor:
    shape = (samples, *scene.has_agent.shape, 10)
    return torch.randn(shape, generator=torch.Generator().manual_seed(1))


def in_double(scene: SceneTensors) -> SceneTensors:
    return scene.to("cpu", torch.float64)


def test_turning_and_moving_a_scene_changes_nothing() -> None:
    scene = in_double(scene_batch(5, 9))
    model, noisy = small_model().double(), noise(scene).double()
    turned = scene.rotated(torch.tensor([1.0, -2.5], dtype=torch.float64))
    move = torch.tensor([100.0, -50.0, 0.0], dtype=torch.float64)
    moved = replace(
        turned,
        agent_pose=turned.agent_pose + move,
        piece_pose=turned.piece_pose + move,
    )
    expected = denoised(model, scene, noisy)
    found = denoised(model, moved, noisy)
    there = scene.has_agent
    assert torch.allclose(found[:, there], expected[:, there], atol=1e-9)


def test_the_order_of_agents_does_not_matter() -> None:
    scene = in_double(scene_batch(7))
    model, noisy = small_model().double(), noise(scene).double()
    order = torch.tensor([3, 0, 6, 2, 5, 1, 4])
    place = torch.argsort(order)
    shuffled = replace(
        scene,
        **{
            one.name: getattr(scene, one.name)[:, order]
            for one in fields(scene)
            if one.name.startswith(("agent", "near", "candid", "future"))
            or one.name in ("has_agent", "has_candidate", "has_future")
        },
    )
    near = shuffled.near_agents
    shuffled = replace(
        shuffled, near_agents=torch.where(near >= 0, place[near.clamp_min(0)], near)
    )
    expected = denoised(model, scene, noisy)[:, :, order]
    found = denoised(model, shuffled, noisy[:, :, order])
    assert torch.allclose(found, expected, atol=1e-9)


def test_padding_and_masked_agents_have_no_influence() -> None:
    scene, model = scene_batch(4, 9), small_model()
    noisy = noise(scene)
    expected = denoised(model, scene, noisy)
    absent = ~scene.has_agent
    other = replace(
        scene,
        agent_pose=torch.where(absent[..., None], 7.0, scene.agent_pose),
        agent_speed=torch.where(absent, 5.0, scene.agent_speed),
        future=torch.where(absent[..., None], 3.0, scene.future),
        piece_pose=torch.where(scene.has_piece[..., None], scene.piece_pose, 9.0),
    )
    changed = torch.where(absent[..., None], 50.0, noisy)
    found = denoised(model, other, changed)
    assert torch.equal(found[:, scene.has_agent], expected[:, scene.has_agent])


def test_an_agent_taken_out_of_the_mask_is_as_if_it_were_not_there() -> None:
    scene, model = scene_batch(9), small_model()
    noisy = noise(scene)
    gone = scene.has_agent.clone()
    gone[0, 3] = False
    without = replace(scene, has_agent=gone)
    expected = denoised(model, without, noisy)
    strange = replace(without, agent_pose=scene.agent_pose.clone())
    strange.agent_pose[0, 3] += 100.0
    far = noisy.clone()
    far[:, 0, 3] = 40.0
    found = denoised(model, strange, far)
    assert torch.equal(found[:, gone], expected[:, gone])
    assert not torch.equal(denoised(model, scene, noisy)[:, gone], expected[:, gone])


def test_a_scene_is_denoised_alone_as_in_a_batch() -> None:
    model = small_model()
    together, alone = scene_batch(4, 9), scene_batch(4)
    noisy = noise(together)
    found = denoised(model, alone, noisy[:, :1, :4])
    expected = denoised(model, together, noisy)[:, :1, :4]
    assert torch.allclose(found, expected, atol=1e-5)


def test_given_agents_come_out_as_they_are_and_are_seen_by_others() -> None:
    scene, model = scene_batch(6), small_model()
    noisy = noise(scene)
    level = torch.full(noisy.shape[:-1], 0.6)
    level[:, :, 2] = 0.0
    found = denoised(model, scene, noisy, level)
    assert torch.equal(found[:, :, 2], noisy[:, :, 2])
    other = noisy.clone()
    other[:, :, 2] += 1.0
    assert not torch.equal(
        denoised(model, scene, other, level)[:, :, 3], found[:, :, 3]
    )


def test_waypoints_of_neighbors_are_seen_only_if_wanted() -> None:
    """With hidden states of neighbours cut off, only way points can tell."""
    scene, noisy = scene_batch(6), noise(scene_batch(6))
    other = noisy.clone()
    other[:, :, 2] += 1.0
    near = (scene.near_agents[0] == 2).any(-1)
    for sees in (True, False):
        model = small_model(sees_way_points=sees)
        for block in model.blocks:
            keys = block.project  # type: ignore[union-attr]
            with torch.no_grad():
                keys.weight[-2 * 32 :] = 0  # type: ignore[union-attr,operator,index]
        changed = denoised(model, scene, other) != denoised(model, scene, noisy)
        assert changed[0, 0, near].any() == sees


def grown(former: TrajectoryDenoiser, **changes: object) -> TrajectoryDenoiser:
    """A fresh network with the weights of a former one where there are such."""
    model = small_model(seed=1, **changes)
    start_from(model, former.state_dict(), "former")
    return model


def test_a_network_grown_from_a_former_one_computes_the_same_at_first() -> None:
    former, scene = small_model(**PLAIN), scene_batch(6, 9)
    new = grown(former, num_near_agents=8)
    assert len(new.state_dict()) > len(former.state_dict())
    expected = denoised(former, scene, noise(scene))
    assert torch.allclose(denoised(new, scene, noise(scene)), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("switch", "weights", "changes"),
    [
        ("sees_signals", "agent_in", {"piece_signal": 0.3}),
        ("sees_boundary", "boundary_out", {"boundary_shape": 0.3}),
        ("sees_activity", "activity_in", {"agent_activity": 1}),
        ("sees_activity", "neighbor_activity_in", {"agent_activity": 1}),
    ],
)
def test_what_is_added_is_seen_only_if_wanted(
    switch: str, weights: str, changes: dict[str, float]
) -> None:
    scene = scene_batch(6)
    scene = replace(scene, agent_activity=torch.zeros_like(scene.agent_activity))
    changed = replace(
        scene, **{name: getattr(scene, name) + more for name, more in changes.items()}
    )
    for sees in (True, False):
        model = small_model(**{switch: sees})
        if sees:
            layer = getattr(model, weights)
            torch.nn.init.normal_(layer.weight)
        one, two = (denoised(model, each, noise(scene)) for each in (scene, changed))
        assert torch.equal(one, two) != sees


def test_gaps_are_seen_from_the_second_block_on() -> None:
    scene, noisy = scene_batch(6), noise(scene_batch(6))
    wide = replace(scene, agent_size=scene.agent_size + 1.0)
    for sees in (True, False):
        model = small_model(sees_gaps=sees)
        first, second = model.blocks
        assert first.interaction_in.in_features == 24  # type: ignore[union-attr]
        assert second.interaction_in.in_features == (40 if sees else 24)  # type: ignore[union-attr]
        torch.nn.init.zeros_(model.agent_in.weight)
        torch.nn.init.zeros_(model.edge_in.weight)
        torch.nn.init.normal_(second.interaction_in.weight)  # type: ignore[union-attr,arg-type]
        one, two = (denoised(model, each, noisy) for each in (scene, wide))
        assert torch.equal(one, two) != sees


def test_only_the_nearest_agents_are_neighbours() -> None:
    scene = scene_batch(12)
    every = Neighbors.of(scene, 16)
    assert every.row.shape[-1] == 1 + scene.near_agents.shape[-1]
    few = Neighbors.of(scene, 3)
    assert torch.equal(few.row, every.row[..., :4])
    assert torch.equal(few.pose, every.pose[..., :4, :])


@pytest.mark.parametrize("prediction", ["clean", "velocity"])
def test_every_block_makes_a_prediction(prediction: str) -> None:
    scene, model = scene_batch(5), small_model(prediction=prediction)
    noisy = noise(scene)
    with torch.inference_mode():
        level = model.encode_level(torch.full(noisy.shape[:-1], 0.5))
        predictions = model.predictions(noisy, level, model.encode_context(scene))
    assert len(predictions) == model.config.num_blocks
    assert all(one.shape == noisy.shape for one in predictions)
    assert all(torch.isfinite(one).all() for one in predictions)


def test_a_scene_without_pieces_candidates_and_neighbours_is_denoised() -> None:
    scene = scene_batch(1)
    bare = replace(
        scene,
        near_pieces=torch.full_like(scene.near_pieces, -1),
        has_candidate=torch.zeros_like(scene.has_candidate),
    )
    assert torch.isfinite(denoised(small_model(), bare, noise(bare))).all()


def test_half_precision_stays_close() -> None:
    scene, model = scene_batch(8), small_model()
    noisy = noise(scene)
    expected = denoised(model, scene, noisy)
    with torch.autocast("cpu", torch.bfloat16):
        found = denoised(model, scene, noisy)
    assert found.dtype == torch.float32
    assert (found - expected).abs().max() < 0.1


def test_all_noise_levels_at_once_are_each_of_them_alone() -> None:
    scene, model = scene_batch(5, 7), small_model()
    noisy = noise(scene)
    with torch.inference_mode():
        table = model.encode_level(torch.tensor([0.9, 0.6])[:, None, None, None])
        found = model.denoise(noisy, table.at(1), model.encode_context(scene))
    assert torch.allclose(found, denoised(model, scene, noisy, 0.6), atol=1e-5)
