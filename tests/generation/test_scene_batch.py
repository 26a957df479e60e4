import numpy as np
import torch

from pd_editor.generation.features.map_pieces import BOUNDARY_SHAPE, PIECE_SHAPE
from pd_editor.generation.inputs import (
    batch_of,
    pose_features,
    relative_pose,
)
from tests.generation.trajectory.scenes import arc_basis, packed_scene, scene_batch


def test_scenes_are_padded_with_nothing() -> None:
    scenes = [packed_scene(3, 25, 1), packed_scene(11, 40, 2)]
    batch = batch_of(scenes)
    assert batch.has_agent.sum(-1).tolist() == [3, 11]
    assert batch.has_piece.sum(-1).tolist() == [25, 40]
    for index, scene in enumerate(scenes):
        count = len(scene.agent_pose)
        assert np.array_equal(batch.agent_pose[index, :count], scene.agent_pose)
        assert np.array_equal(batch.candidates[index, :count], scene.candidates)
        assert (batch.agent_pose[index, count:] == 0).all()
        assert (batch.near_agents[index, count:] == -1).all()
        assert not batch.has_future[index, count:].any()


def test_mirroring_twice_and_turning_back_change_nothing() -> None:
    scene = scene_batch(4, 7)
    twice = scene.mirrored().mirrored()
    angle = torch.tensor([0.7, -2.0])
    back = scene.rotated(angle).rotated(-angle)
    for name in ("piece_pose", "piece_shape", "agent_pose", "candidates", "future"):
        assert torch.equal(getattr(twice, name), getattr(scene, name))
        assert torch.allclose(getattr(back, name), getattr(scene, name), atol=1e-5)
    turned = (twice.boundary_pose - scene.boundary_pose)[..., 2]
    assert torch.allclose(turned.cos(), torch.ones_like(turned))
    assert torch.equal(twice.boundary_shape, scene.boundary_shape)


def test_in_a_mirror_the_boundary_runs_the_other_way() -> None:
    scene = scene_batch(4)
    pose, mirrored = scene.boundary_pose, scene.mirrored().boundary_pose
    assert torch.equal(mirrored[..., :2], pose[..., :2] * torch.tensor([1.0, -1.0]))
    assert torch.allclose(mirrored[..., 2].cos(), -pose[..., 2].cos(), atol=1e-6)
    assert torch.allclose(mirrored[..., 2].sin(), pose[..., 2].sin(), atol=1e-6)
    shape, other = scene.boundary_shape, scene.mirrored().boundary_shape
    before, after = (
        BOUNDARY_SHAPE.index("turn_before"),
        BOUNDARY_SHAPE.index("turn_after"),
    )
    assert torch.equal(shape[..., before], other[..., after])


def test_mirrored_latents_are_those_of_mirrored_futures() -> None:
    scene, basis = scene_batch(6), arc_basis()
    speed = scene.agent_speed[0].numpy()
    own = basis.decode(scene.future[0].numpy(), speed)
    other = basis.decode(scene.mirrored().future[0].numpy(), speed)
    assert np.allclose(own * [1, -1], other)
    left = PIECE_SHAPE.index("left_width")
    shape, mirrored = scene.piece_shape, scene.mirrored().piece_shape
    assert torch.equal(shape[..., left], mirrored[..., left + 1])


def test_relative_poses_stay_when_the_scene_is_turned_and_moved() -> None:
    random = torch.Generator().manual_seed(0)
    poses = torch.rand((5, 3), generator=random, dtype=torch.float64) * 6 - 3
    turn, move = 1.1, torch.tensor([30.0, -7.0], dtype=torch.float64)
    cos, sin = np.cos(turn), np.sin(turn)
    matrix = torch.tensor([[cos, -sin], [sin, cos]])
    moved = torch.cat([poses[:, :2] @ matrix.T + move, poses[:, 2:] + turn], dim=-1)
    before = relative_pose(poses[None], poses[:, None])
    after = relative_pose(moved[None], moved[:, None])
    assert torch.allclose(before, after)
    back = relative_pose(poses[:1], poses[1:2])[0]
    x, y, cos_, sin_ = pose_inverse(back)
    assert torch.allclose(
        torch.stack([x, y, cos_, sin_]), before[1, 0] * 0 + before[0, 1]
    )
    assert pose_features(before).abs().max() < 10


def pose_inverse(pose: torch.Tensor) -> tuple[torch.Tensor, ...]:
    x, y, cos, sin = pose
    return -(cos * x + sin * y), sin * x - cos * y, cos, -sin
