"""Shapes of agents and marks have only faces that can be seen from above the ground."""

import numpy as np
import pytest

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.viewer.meshes.agent_shapes import ring, shape_of


@pytest.mark.parametrize("kind", [AgentKind.VEHICLE, AgentKind.PEDESTRIAN])
def test_no_face_looks_down(kind: AgentKind):
    shape = shape_of(kind)
    for part in filter(None, (shape.body, shape.dark)):
        assert part.face_normals[:, 2].min() > -0.9
    assert shape.body.face_normals[:, 2].max() > 0.9


def test_a_ring_is_flat_and_looks_up():
    upwards = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(ring(0.9).face_normals @ upwards, 1.0)
