from dataclasses import replace

import torch

from pd_editor.generation.initial_state.network.state_encoding import encode_states
from pd_editor.generation.initial_state.state_overlap import (
    OverlapVectors,
    overlap_depth_m,
)
from pd_editor.generation.inputs import SceneTensors
from tests.generation.initial_state.scenes import scene_batch


def cars_at(*poses: tuple[float, float, float]) -> SceneTensors:
    scene = scene_batch(len(poses))
    size = torch.tensor([4.6, 1.9]).expand_as(scene.agent_size)
    return replace(
        scene,
        agent_pose=torch.tensor([poses]),
        agent_size=size.clone(),
        agent_kind=torch.zeros_like(scene.agent_kind),
    )


def codes_of(scene: SceneTensors) -> torch.Tensor:
    return encode_states(scene.agent_pose, scene.agent_speed)


def vectors_of(scene: SceneTensors) -> torch.Tensor:
    place = torch.view_as_complex(scene.agent_pose[..., :2].contiguous())
    heading = scene.agent_pose[..., 2]
    axis = torch.complex(heading.cos(), heading.sin())
    return torch.view_as_real(OverlapVectors.of(scene)(place, axis))


def test_depth_of_cars_in_line_and_side_by_side():
    scene = cars_at((0, 0, 0), (4.0, 0, 0), (0, 1.5, 0), (30, 0, 0))
    depth = overlap_depth_m(codes_of(scene), scene)[0]
    torch.testing.assert_close(
        depth[0], torch.tensor([0, 0.6, 0.4, 0]), rtol=0, atol=1e-3
    )
    torch.testing.assert_close(depth, depth.T)


def test_pushing_by_the_vectors_takes_the_overlap_away():
    scene = cars_at((0, 0, 0.1), (4.0, 0.4, 0), (40, 0, 0), (40, 1.4, 3.0))
    codes = codes_of(scene)
    vectors = vectors_of(scene)
    before = overlap_depth_m(codes, scene).sum()
    moved = codes.clone()
    moved[..., :2] += vectors.sum(dim=-2) / 2 / 62.0
    after = overlap_depth_m(moved, scene).sum()
    assert before > 0.5
    assert after < 0.02 * before


def test_vectors_are_as_long_as_the_overlap_is_deep():
    random = torch.Generator().manual_seed(0)
    poses = torch.rand((40, 3), generator=random) * torch.tensor([40.0, 40.0, 6.3])
    scene = cars_at(*[(x, y, turn) for x, y, turn in poses.tolist()])
    depth = overlap_depth_m(codes_of(scene), scene)
    assert 20 < (depth > 0).sum() < 1000
    # Vectors are nudged by a millimetre.
    torch.testing.assert_close(vectors_of(scene).norm(dim=-1), depth, rtol=0, atol=5e-3)


def test_cars_in_one_place_part():
    scene = cars_at((3, 4, 0.7), (3, 4, 0.7))
    vectors = vectors_of(scene)[0]
    torch.testing.assert_close(vectors[0, 1], -vectors[1, 0])
    assert vectors[0, 1].norm() > 1.5


def test_pedestrians_and_padding_do_not_overlap():
    scene = cars_at((0, 0, 0), (0.5, 0, 0), (0.2, 0, 0))
    scene = replace(
        scene,
        agent_kind=torch.tensor([[4, 4, 0]]),
        has_agent=torch.tensor([[True, True, False]]),
    )
    assert not overlap_depth_m(codes_of(scene), scene).any()
    assert not vectors_of(scene).any()
