import numpy as np
import torch

from pd_editor.diffusion.agent_counts import (
    HALF_SIDES_M,
    AgentCounts,
    fit_agent_counts,
    lane_length_m,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.windows.scene_features import AGENT_KINDS
from tests.diffusion.pose_scenes import packed_scene


def test_counts_are_those_of_the_scenes():
    scenes = [packed_scene(n, 12, seed=n) for n in (3, 17)]
    found = fit_agent_counts(scenes)
    assert len(found.counts) == 2 * len(HALF_SIDES_M)
    for row, (side, scene) in enumerate((s, c) for s in HALF_SIDES_M for c in scenes):
        inside = (np.abs(scene.agent_pose[:, :2]) <= side).all(axis=1)
        expected = [(scene.agent_kind[inside] == k).sum() for k in range(5)]
        assert found.half_side_m[row] == side
        assert found.counts[row].tolist() == expected


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
    rows = np.zeros((300, 7))
    rows[:, 0] = 62.0
    rows[:, 1] = np.linspace(100, 3000, 300)
    rows[:, 2] = np.rint(rows[:, 1] / 100)
    counts = AgentCounts.from_tensor(torch.from_numpy(rows))
    random = np.random.default_rng(0)
    for lane_m, side, expected in ((500, 62, 5), (2500, 62, 25), (625, 31, 6.25)):
        drawn = [counts.draw(lane_m, side, random) for _ in range(300)]
        vehicles = [one.get(AgentKind.VEHICLE, 0) for one in drawn]
        assert abs(np.mean(vehicles) - expected) < 1
        assert all(set(one) <= set(AGENT_KINDS) for one in drawn)
