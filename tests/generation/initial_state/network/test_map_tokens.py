import math
from dataclasses import replace

import torch

from pd_editor.generation.features.map_pieces import CROSSWALK_KIND
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network.features import (
    NoisyPoses,
    noise_factors,
)
from pd_editor.generation.initial_state.network.map_tokens import (
    MapTokens,
    NearTokens,
    TokenGroup,
)
from pd_editor.generation.inputs import SceneTensors
from tests.generation.initial_state.scenes import scene_batch


def near(scene: SceneTensors, position_m: torch.Tensor, number: int) -> NearTokens:
    """Tokens near positions [B A]; each token is encoded as its own index."""
    index = torch.arange(scene.has_piece.shape[1]).float()
    encoded = index.expand(scene.has_piece.shape)[..., None].contiguous()
    poses = NoisyPoses(position_m[:, None], torch.ones_like(position_m)[:, None])
    noise = noise_factors(torch.tensor(1.0), torch.tensor(1.0), num_offsets=2)
    tokens = MapTokens.of(TokenGroup.of_lanes(scene, encoded, number))
    return tokens.seen_by(scene.agent_kind).near(poses, noise)


def test_nearest_tokens_by_brute_force():
    random = torch.Generator().manual_seed(0)
    scene = scene_batch(3, 5)
    kinds = torch.zeros_like(scene.piece_kind)
    pose = scene.piece_pose.clone()
    pose[..., :2] = 30 * torch.randn(pose[..., :2].shape, generator=random)
    has_piece = scene.has_piece.clone()
    has_piece[1, 4:] = False
    scene = replace(scene, piece_kind=kinds, piece_pose=pose, has_piece=has_piece)
    shape = scene.has_agent.shape
    position = 30 * torch.randn(shape, dtype=torch.complex64, generator=random)
    found = near(scene, position, 3)
    for row in range(2):
        for agent in range(shape[1]):
            point = torch.view_as_real(position[row, agent])
            distance = {
                index: math.dist(point, pose[row, index, :2])
                for index in range(pose.shape[1])
                if has_piece[row, index]
            }
            expected = sorted(distance, key=lambda index: distance[index])[:3]
            assert set(found.encoded[row, 0, agent, :, 0].tolist()) == set(expected)


def test_missing_tokens_are_hidden():
    scene = scene_batch(3)
    has_piece = scene.has_piece.clone()
    has_piece[:, 2:] = False
    scene = replace(scene, has_piece=has_piece)
    found = near(scene, torch.zeros_like(scene.agent_speed) + 0j, 5)
    assert found.mask.added is not None
    assert (found.mask.added.isinf().sum(dim=-1) == 3).all()


def test_pedestrians_see_crosswalks_first():
    scene = scene_batch(2)
    pose = torch.full_like(scene.piece_pose, 50.0)
    pose[0, :2, :2] = torch.tensor([[1.0, 0.0], [1.5, 0.0]])
    kinds = torch.zeros_like(scene.piece_kind)
    kinds[0, 1] = CROSSWALK_KIND
    walks = torch.tensor([[PEDESTRIAN, 0]])
    scene = replace(scene, piece_pose=pose, piece_kind=kinds, agent_kind=walks)
    found = near(scene, torch.zeros(1, 2) + 0j, 1)
    assert found.encoded[0, 0, :, 0, 0].tolist() == [1.0, 0.0]


def test_the_boundary_has_a_quota_of_its_own():
    scene = scene_batch(4, 7)
    poses = NoisyPoses(
        torch.zeros_like(scene.agent_speed)[:, None] + 1j,
        torch.ones_like(scene.agent_speed)[:, None] + 0j,
    )
    noise = noise_factors(torch.tensor(1.0), torch.tensor(1.0), num_offsets=2)
    lanes = torch.zeros((*scene.has_piece.shape, 1))
    pose = scene.boundary_pose.clone()
    pose[..., :2] = 40.0
    pose[:, 3] = torch.tensor([3.0, 4.0, 0.5])
    has_boundary = torch.zeros_like(scene.has_boundary)
    has_boundary[:, [3, 5]] = True
    scene = replace(scene, boundary_pose=pose, has_boundary=has_boundary)
    boundary = torch.arange(pose.shape[1]).float().expand(pose.shape[:2])[..., None] + 1
    tokens = MapTokens.of(
        TokenGroup.of_lanes(scene, lanes, 5), TokenGroup.of_boundary(scene, boundary, 3)
    )
    found = tokens.near(poses, noise)
    assert found.numbers == (5, 3)
    assert (found.encoded[..., :5, :] == 0).all()
    seen = found.mask.added
    assert seen is not None
    assert seen[0, 0, 0, 0].isinf().tolist() == [False] * 5 + [True] * 3
    for row in range(2):
        codes = found.encoded[row, 0, 0, :, 0][seen[row, 0, 0, 1] == 0]
        assert sorted(codes.tolist()) == [4.0, 6.0]
    nearest = found.encoded[..., 5:, 0] == 4.0
    axis = found.axis[..., 5:][nearest]
    torch.testing.assert_close(
        axis, torch.polar(torch.ones(1), torch.tensor([0.5])).expand(axis.shape)
    )
