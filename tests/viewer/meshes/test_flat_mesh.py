import io

import numpy as np
import trimesh

from pd_editor.scene.geometry.lines import Lines
from pd_editor.viewer.meshes.flat_mesh import (
    FlatMesh,
    Primitive,
    glb_of,
    merged,
    ribbons,
)


def signed_areas(mesh: FlatMesh) -> np.ndarray:
    a, b, c = (mesh.points_m[mesh.faces[:, corner]] for corner in range(3))
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def test_a_straight_ribbon_has_length_times_width_and_faces_up():
    mesh = ribbons(Lines.of([np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]])]), 0.5)
    areas = signed_areas(mesh)
    assert (areas > 0).all()
    assert np.isclose(areas.sum(), 10 * 0.5)


def test_merging_keeps_every_triangle():
    one = ribbons(Lines.of([np.array([[0.0, 0.0], [1.0, 0.0]])]), 1.0)
    two = ribbons(Lines.of([np.array([[5.0, 5.0], [5.0, 9.0]])]), 1.0)
    both = merged([one, two])
    assert np.isclose(signed_areas(both).sum(), 1.0 + 4.0)
    assert both.faces.max() == len(both.points_m) - 1


def test_glb_is_read_back_by_trimesh():
    mesh = ribbons(Lines.of([np.array([[0.0, 0.0], [10.0, 0.0]])]), 2.0)
    primitive = Primitive(
        points_m=mesh.points_m,
        faces=mesh.faces,
        height_m=0.25,
        color=(1.5, 0.2, 0.1),
        vertex_opacity=np.linspace(0, 1, len(mesh.points_m)),
    )
    scene = trimesh.load(io.BytesIO(glb_of([primitive, primitive])), file_type="glb")
    assert len(scene.geometry) == 2
    loaded = next(iter(scene.geometry.values()))
    assert np.allclose(loaded.bounds, [[0, -1, 0.25], [10, 1, 0.25]])
    assert np.isclose(loaded.area, 20.0)


def test_nothing_to_draw_is_still_a_valid_file():
    scene = trimesh.load(io.BytesIO(glb_of([])), file_type="glb")
    assert sum(g.area for g in scene.geometry.values()) == 0
