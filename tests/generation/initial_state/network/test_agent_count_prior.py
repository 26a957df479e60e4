import numpy as np
import torch
from shapely import MultiLineString, Point

from pd_editor.generation.features.scene_features import AGENT_KINDS, PackedScene
from pd_editor.generation.initial_state.network.agent_count_prior import (
    HALF_SIDES_M,
    AgentCounts,
    fit_agent_counts,
    lane_length_m,
)
from pd_editor.scene.agent_kind import AgentKind
from tests.generation.initial_state.scenes import packed_scene


def test_counts_are_those_of_the_scenes():
    scenes = [packed_scene(n, 12, seed=n) for n in (3, 17)]
    found = fit_agent_counts(scenes)
    assert len(found.counts) == 2 * len(HALF_SIDES_M)
    for row, (side, scene) in enumerate((s, c) for s in HALF_SIDES_M for c in scenes):
        inside = (np.abs(scene.agent_pose[:, :2]) <= side).all(axis=1)
        expected = [(scene.agent_kind[inside] == k).sum() for k in range(5)]
        assert found.half_side_m[row] == side
        assert found.counts[row].sum(axis=(1, 2)).tolist() == expected
        moves = scene.agent_speed[inside] >= 0.5
        assert found.counts[row, :, 1].sum() == moves.sum()
        x, y = scene.agent_pose[:, :2].T
        segments = lane_segments(scene)
        far = np.array(
            [segments.distance(Point(*at)) > 4 for at in zip(x, y, strict=True)]
        )
        far &= scene.agent_kind != 4
        assert found.counts[row, ..., 0].sum() == far[inside].sum()


def lane_segments(scene: PackedScene) -> MultiLineString:
    is_lane = scene.piece_kind < 3
    pose, half = scene.piece_pose[is_lane], 5 * scene.piece_shape[is_lane, :1]
    step = half * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    ends = np.stack([pose[:, :2] - step, pose[:, :2] + step], axis=1)
    return MultiLineString(ends.tolist())


def test_there_and_back_as_an_array():
    counts = fit_agent_counts([packed_scene(n) for n in range(1, 6)])
    again = AgentCounts.from_tensor(counts.as_tensor())
    assert np.array_equal(again.counts, counts.counts)
    assert np.allclose(again.lane_m, counts.lane_m, rtol=1e-6)


def test_length_of_lanes_in_the_square():
    pose = np.array([[0, 0, 0], [30, 0, 0], [63, 0, 0], [1, 1, 0]], float)
    shape = np.zeros((4, 12))
    shape[:, 0] = [1.0, 0.5, 1.0, 1.0]
    kind = np.array([0, 0, 0, 3])
    assert lane_length_m(pose, shape, kind, 62.0) == 15.0


def test_drawn_numbers_are_like_those_of_roads_alike():
    rows = np.zeros((300, 22))
    rows[:, 0] = 62.0
    rows[:, 1] = np.linspace(100, 3000, 300)
    rows[:, 2] = np.rint(rows[:, 1] / 100)
    counts = AgentCounts.from_tensor(torch.from_numpy(rows))
    random = np.random.default_rng(0)
    for lane_m, side, expected in ((500, 62, 5), (2500, 62, 25), (625, 31, 6.25)):
        drawn = [counts.sample(lane_m, side, random) for _ in range(300)]
        vehicles = [one.get(AgentKind.VEHICLE, 0) for one in drawn]
        assert abs(np.mean(vehicles) - expected) < 1
        assert all(set(one) <= set(AGENT_KINDS) for one in drawn)


NOBODY = np.zeros((5, 2, 2), int)


def crowded_and_empty_squares() -> AgentCounts:
    """Squares of 10 vehicles that move, and of 40 of which 3 in 4 stand off the road."""
    counts = np.zeros((200, 5, 2, 2), int)
    counts[:100, 0, 1, 1] = 10
    counts[100:, 0, 1, 1] = 10
    counts[100:, 0, 0, 0] = 30
    counts[:, 4, 1, 1] = 1
    return AgentCounts(
        half_side_m=np.full(200, 62.0),
        lane_m=np.tile(np.linspace(900, 1100, 100), 2),
        counts=counts,
    )


def test_traits_are_those_of_squares_as_full():
    squares, random = crowded_and_empty_squares(), np.random.default_rng(0)
    few = [
        squares.sample_attributes(np.zeros(11, int), NOBODY, 1000, 62, random)
        for _ in range(99)
    ]
    many = [
        squares.sample_attributes(np.zeros(41, int), NOBODY, 1000, 62, random)
        for _ in range(99)
    ]
    assert np.mean([one.moves for one in few]) > 0.85
    assert abs(np.mean([one.moves for one in many]) - 0.25) < 0.05
    assert all((one.moves == one.on_road).all() for one in few + many)


def test_those_present_are_taken_off():
    """Ten that move are there; the thirty that are wanted yet are the parked ones."""
    squares, random = crowded_and_empty_squares(), np.random.default_rng(0)
    present = NOBODY.copy()
    present[0, 1, 1] = 10
    found = [
        squares.sample_attributes(np.zeros(30, int), present, 1000, 62, random)
        for _ in range(99)
    ]
    assert np.mean([one.moves for one in found]) < 0.1


def test_on_the_road_only_means_fewer_where_many_park_beside_it():
    squares, random = crowded_and_empty_squares(), np.random.default_rng(0)
    drawn = [squares.sample(1000, 62, random, only_on_road=True) for _ in range(99)]
    assert {one[AgentKind.VEHICLE] for one in drawn} == {10}
    drawn = [squares.sample(1000, 62, random) for _ in range(99)]
    numbers = [one[AgentKind.VEHICLE] for one in drawn]
    assert abs(np.mean(numbers) - 25) < 3
    assert np.std(numbers) < 9  # Squares alone: 15.


def test_wishes_about_traits_are_kept():
    squares, random = crowded_and_empty_squares(), np.random.default_rng(0)
    kinds = np.repeat([0, 2, 4], 1000)
    for share in (0.0, 0.3, 1.0):
        found = squares.sample_attributes(
            kinds, NOBODY, 1000, 62, random, moving_share=share, only_on_road=True
        )
        assert found.on_road.all()
        for kind in (0, 2, 4):
            assert abs(found.moves[kinds == kind].mean() - share) < 1e-3
    found = squares.sample_attributes(kinds, NOBODY, 1000, 62, random, moving_share=0.5)
    assert not found.on_road[(kinds == 0) & ~found.moves].any()
