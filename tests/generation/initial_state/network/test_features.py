import math

import shapely
import shapely.affinity
import torch

from pd_editor.generation.initial_state.network.features import (
    NUM_AGENT_FEATURES,
    NUM_FOLDED_FEATURES,
    NUM_GAP_FEATURES,
    NUM_PIECE_FEATURES,
    RELATION_WAVELENGTHS_M,
    BoxPairs,
    NoisyPoses,
    agent_relations,
    fading,
    noise_factors,
    piece_relations,
    rotated_back,
    waves,
)

NUM_WAVES = 4 * len(RELATION_WAVELENGTHS_M)


def directions(angle: torch.Tensor) -> torch.Tensor:
    return torch.polar(torch.ones_like(angle), angle)


def test_waves_repeat_after_their_wavelength_in_metres():
    points = torch.tensor([[0.3, -1.2]])
    moved = points + torch.tensor([[4.0, 8.0]])
    found = [waves(p, (4.0,)) for p in (points, moved)]
    torch.testing.assert_close(found[0], found[1], rtol=0, atol=1e-5)
    half = waves(points + torch.tensor([[2.0, 2.0]]), (4.0,))
    torch.testing.assert_close(half, -found[0], rtol=0, atol=1e-5)


def test_faded_waves_of_noisy_points_are_what_is_expected_of_them():
    random = torch.Generator().manual_seed(0)
    point, noise = torch.tensor([1.1, -0.4]), 0.7
    cloud = point + noise * torch.randn((200_000, 2), generator=random)
    expected = waves(cloud, RELATION_WAVELENGTHS_M).mean(dim=0)
    factor = fading(RELATION_WAVELENGTHS_M, torch.tensor(noise)).repeat(2)
    found = waves(point, RELATION_WAVELENGTHS_M) * factor
    torch.testing.assert_close(found, expected, rtol=0, atol=0.01)


def test_vectors_in_their_own_frame_are_along_x():
    random = torch.Generator().manual_seed(0)
    axis = torch.view_as_real(directions(torch.randn(9, generator=random)))
    found = rotated_back(3 * axis, axis)
    torch.testing.assert_close(found, torch.tensor([[3.0, 0.0]]).expand(9, 2))


def test_offsets_are_in_metres():
    """The scale of the road and that of the noisy states must be the same."""
    noise = noise_factors(
        torch.tensor([[[[0.05]]]]), torch.tensor([[[[0.08]]]]), num_offsets=2
    )
    poses = NoisyPoses(
        torch.tensor([[[31.0 - 20.0j]]]), directions(torch.tensor([[[0.9]]]))
    )
    middle, axis = torch.tensor([[[[28.0 - 24.0j]]]]), torch.tensor([[[[0.6 + 0.8j]]]])
    found = piece_relations(poses, middle, axis, noise)[0, 0, 0, 0]
    assert found.shape == (NUM_PIECE_FEATURES,)
    turn = 0.9 - math.atan2(4, 3)
    sine = 10 * math.sin(turn)
    own = [-5 * math.cos(turn), 5 * math.sin(turn)]
    lengths = [5.0, 0.0, 50.0, 0.0, sine, *own, 10 * own[0], 10 * own[1]]
    torch.testing.assert_close(
        found[NUM_WAVES:],
        torch.tensor(
            [
                *(math.asinh(one) / 3 for one in lengths),
                math.log1p(5) / 3,
                math.cos(turn),
                math.sin(turn),
            ]
        ),
        rtol=1e-3,
        atol=1e-4,
    )
    expected = waves(torch.tensor([5.0, 0.0]), RELATION_WAVELENGTHS_M)
    expected = expected * noise.fading[0, 0, 0, 0, :NUM_WAVES]
    torch.testing.assert_close(found[:NUM_WAVES], expected, rtol=1e-3, atol=1e-3)


def test_relations_stay_when_everything_is_moved_and_turned():
    random = torch.Generator().manual_seed(0)
    place = 30 * torch.randn((1, 1, 6), dtype=torch.complex64, generator=random)
    heading = directions(torch.randn((1, 1, 6), generator=random))
    noise = noise_factors(torch.tensor(0.5), torch.tensor(0.5), num_offsets=1)
    turn = directions(torch.tensor(0.8))
    before = agent_relations(NoisyPoses(place, heading), noise)
    after = agent_relations(NoisyPoses(place * turn + 11.0, heading * turn), noise)
    assert before.shape[-1] == NUM_AGENT_FEATURES
    torch.testing.assert_close(before, after, rtol=1e-3, atol=1e-3)


def turned_poses(num: int, seed: int = 0) -> NoisyPoses:
    random = torch.Generator().manual_seed(seed)
    place = 4 * torch.randn((1, 1, num), dtype=torch.complex64, generator=random)
    return NoisyPoses(place, directions(7 * torch.rand((1, 1, num), generator=random)))


def test_gaps_between_boxes_are_those_of_the_shapes():
    """Against shapely: boxes overlap where the largest gap is below 0."""
    poses, random = turned_poses(40), torch.Generator().manual_seed(1)
    size = 1 + 4 * torch.rand((1, 40, 2), generator=random)
    noise = noise_factors(
        torch.tensor(1.0), torch.tensor(1.0), num_offsets=1, sees_gaps=True
    )
    found = agent_relations(poses, noise, boxes=BoxPairs.of(size))[0, 0]
    gaps = (3 * found[..., NUM_AGENT_FEATURES : NUM_AGENT_FEATURES + 5]).sinh()
    shapes = [
        shapely.affinity.translate(
            shapely.affinity.rotate(
                shapely.box(-length / 2, -width / 2, length / 2, width / 2),
                float(turn.angle()),
                use_radians=True,
            ),
            float(place.real),
            float(place.imag),
        )
        for (length, width), place, turn in zip(
            size[0].tolist(), poses.position_m[0, 0], poses.direction[0, 0], strict=True
        )
    ]
    meets = torch.tensor([[a.intersects(b) for b in shapes] for a in shapes])
    assert 100 < meets.sum() < 1500
    assert torch.equal(gaps[..., 4] < 0, meets)
    assert torch.equal(gaps[..., 4], gaps[..., :4].amax(dim=-1))
    scaled = (3 * found[..., NUM_AGENT_FEATURES + 5 :]).sinh()
    assert found.shape[-1] == NUM_AGENT_FEATURES + NUM_GAP_FEATURES
    torch.testing.assert_close(scaled, gaps / 1.05, rtol=1e-3, atol=1e-3)


def test_cars_facing_either_way_look_alike_where_turns_are_folded():
    poses = turned_poses(6)
    noise = noise_factors(
        torch.tensor(0.5), torch.tensor(0.1), num_offsets=1, folds_turns=True
    )
    folded = slice(NUM_AGENT_FEATURES, NUM_AGENT_FEATURES + NUM_FOLDED_FEATURES)
    before = agent_relations(poses, noise, folds_turns=True)[..., folded]
    for turn, same in ((torch.pi, slice(0, 6)), (torch.pi / 2, [2, 3, 5])):
        other = poses.direction.clone()
        other[..., 1] *= directions(torch.tensor(turn))
        after = agent_relations(
            poses._replace(direction=other), noise, folds_turns=True
        )[..., folded]
        torch.testing.assert_close(
            after[..., same], before[..., same], rtol=1e-3, atol=1e-3
        )
    assert not torch.allclose(after, before, atol=0.1)
    angle = torch.tensor(0.03)
    pair = NoisyPoses(
        torch.zeros((1, 1, 2)) + 0j,
        directions(torch.stack([0 * angle, angle]))[None, None],
    )
    fine = agent_relations(pair, noise, folds_turns=True)[0, 0, 0, 1, folded]
    expected = [math.asinh(math.sin(k * 0.03) / k / 0.12) / 3 for k in (2, 4)]
    torch.testing.assert_close(fine[4:], torch.tensor(expected), rtol=1e-3, atol=1e-4)
