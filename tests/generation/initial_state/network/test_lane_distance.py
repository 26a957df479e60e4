import math
from dataclasses import replace

import numpy as np
import torch
from shapely import LineString, MultiLineString, Point

from pd_editor.generation.initial_state.network.lane_distance import (
    follows_lanes,
    offset_from_lane_m,
)
from tests.generation.initial_state.scenes import scene_batch


def test_offsets_are_those_of_shapely():
    scene = scene_batch(25)
    distance = offset_from_lane_m(scene.agent_pose[..., :2], scene)
    lanes = scene.has_piece[0] & (scene.piece_kind[0] < 3)
    pose, half = scene.piece_pose[0, lanes].numpy(), 5 * scene.piece_shape[0, lanes, 0]
    step = half.numpy()[:, None] * np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], 1)
    lines = MultiLineString(
        [
            LineString([middle - one, middle + one])
            for middle, one in zip(pose[:, :2], step, strict=True)
        ]
    )
    for agent, vector, length in zip(
        scene.agent_pose[0], distance[0][0], distance[1][0], strict=True
    ):
        expected = lines.distance(Point(*agent[:2].tolist()))
        assert math.isclose(length, expected, abs_tol=1e-3)
        assert math.isclose(vector.norm(), expected, abs_tol=1e-3)
        assert lines.distance(Point(*(agent[:2] - vector).tolist())) < 1e-3


def test_without_lanes_no_agent_follows_them():
    scene = scene_batch(5)
    assert follows_lanes(scene).tolist() == (scene.agent_kind != 4).tolist()
    bare = replace(scene, piece_kind=torch.full_like(scene.piece_kind, 3))
    assert not follows_lanes(bare).any()
    assert offset_from_lane_m(bare.agent_pose[..., :2], bare)[1].isinf().all()
