import math

import torch

from pd_editor.diffusion.initial_state.features import (
    NEIGHBOR_WAVELENGTHS_M,
    NUM_AGENT_FEATURES,
    NoisyPoses,
    agent_relations,
    nearest_pieces,
    piece_relations,
    relation_features,
    turned,
    turned_back,
    waves,
)


def directions(angle: torch.Tensor) -> torch.Tensor:
    return torch.stack([angle.cos(), angle.sin()], dim=-1)


def test_waves_repeat_after_their_wavelength_in_metres():
    points = torch.tensor([[0.3, -1.2]])
    moved = points + torch.tensor([[4.0, 8.0]])
    found = [waves(p, (4.0,)) for p in (points, moved)]
    torch.testing.assert_close(found[0], found[1], rtol=0, atol=1e-5)
    half = waves(points + torch.tensor([[2.0, 2.0]]), (4.0,))
    torch.testing.assert_close(half, -found[0], rtol=0, atol=1e-5)


def test_waves_of_noisy_points_are_what_is_expected_of_them():
    random = torch.Generator().manual_seed(0)
    point, noise = torch.tensor([1.1, -0.4]), 0.7
    cloud = point + noise * torch.randn((200_000, 2), generator=random)
    expected = waves(cloud, NEIGHBOR_WAVELENGTHS_M).mean(dim=0)
    found = waves(point, NEIGHBOR_WAVELENGTHS_M, torch.tensor(noise))
    torch.testing.assert_close(found, expected, rtol=0, atol=0.01)


def test_turning_there_and_back():
    random = torch.Generator().manual_seed(0)
    vectors = torch.randn((9, 2), generator=random)
    axis = directions(torch.randn(9, generator=random))
    torch.testing.assert_close(turned(turned_back(vectors, axis), axis), vectors)
    x_axis = turned(torch.tensor([[1.0, 0.0]]).expand(9, 2), axis)
    torch.testing.assert_close(x_axis, axis)


def test_offsets_are_told_in_metres():
    """The scale of the road and that of the noisy states must be the same."""
    position = torch.tensor([[[31.0, -20.0]]])
    along = directions(torch.tensor([[0.9]]))
    piece = torch.tensor([[[[28.0, -24.0, 0.6, 0.8]]]])
    noise, turn_noise = torch.tensor([[0.05]]), torch.tensor([[0.08]])
    found = piece_relations(NoisyPoses(position, along, noise, turn_noise), piece)
    turn = 0.9 - math.atan2(4, 3)
    expected = relation_features(
        torch.tensor([[[[5.0, 0.0]]]]),
        directions(torch.tensor([[[turn]]])),
        noise[..., None],
        turn_noise[..., None],
    )
    own, ahead = found.split([NUM_AGENT_FEATURES, 4], dim=-1)
    torch.testing.assert_close(own, expected, rtol=1e-3, atol=1e-4)
    sine = math.asinh(10 * math.sin(turn)) / 3
    distance = math.log1p(5) / 3
    torch.testing.assert_close(
        own[0, 0, 0, -4:],
        torch.tensor([sine, distance, math.cos(turn), math.sin(turn)]),
    )
    metres = torch.tensor([-5 * math.cos(turn), 5 * math.sin(turn)])
    torch.testing.assert_close(
        ahead[0, 0, 0], torch.cat([metres, metres / 0.1]).asinh() / 3
    )


def test_relations_stay_when_everything_is_moved_and_turned():
    random = torch.Generator().manual_seed(0)
    position = 30 * torch.randn((1, 6, 2), generator=random)
    angle = torch.randn((1, 6), generator=random)
    noise = torch.full((1, 6), 0.5)
    turn = torch.tensor(0.8)
    moved = turned(position, directions(turn).expand_as(position)) + 11.0
    before, after = (
        agent_relations(NoisyPoses(place, directions(one), noise, noise))
        for place, one in ((position, angle), (moved, angle + turn))
    )
    torch.testing.assert_close(before, after, rtol=1e-3, atol=1e-3)


def test_nearest_pieces_by_brute_force():
    random = torch.Generator().manual_seed(0)
    position = 30 * torch.randn((2, 5, 2), generator=random)
    middle = 30 * torch.randn((2, 9, 2), generator=random)
    has_piece = torch.ones(2, 9, dtype=torch.bool)
    has_piece[1, 4:] = False
    nobody, none = torch.zeros(2, 5).bool(), torch.zeros(2, 9).bool()
    found = nearest_pieces(position, nobody, middle, none, has_piece, 3)
    for scene in range(2):
        for agent in range(5):
            distance = {
                row: math.dist(position[scene, agent], middle[scene, row])
                for row in range(9)
                if has_piece[scene, row]
            }
            expected = sorted(distance, key=lambda row: distance[row])[:3]
            assert found[scene, agent].tolist() == expected


def test_pedestrians_see_crosswalks_first():
    position = torch.zeros(1, 2, 2)
    middle = torch.tensor([[[1.0, 0.0], [1.5, 0.0]]])
    walks, crossing = torch.tensor([[True, False]]), torch.tensor([[False, True]])
    everything = torch.ones(1, 2, dtype=torch.bool)
    found = nearest_pieces(position, walks, middle, crossing, everything, 1)
    assert found[0, :, 0].tolist() == [1, 0]
