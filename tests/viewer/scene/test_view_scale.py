import numpy as np
import pytest

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.viewer.scene.camera import (
    MIN_LENGTH_PX,
    MIN_WIDTH_PX,
    ViewScale,
    drawn_sizes_m,
)
from tests.builders import straight_drivers


def view_of(half_height_m: float, tilt_rad: float = 0.0) -> ViewScale:
    """A camera over the origin, north up; tilted, it looks ahead to the north."""
    fov = float(np.radians(8.0))
    height = half_height_m / np.tan(fov / 2)
    half = (np.pi - tilt_rad) / 2
    return ViewScale.of_pose(
        wxyz=np.array([np.cos(half), np.sin(half), 0.0, 0.0]),
        position_m=np.array([0.0, -np.tan(tilt_rad) * height, height]),
        look_at_m=np.zeros(3),
        fov_rad=fov,
        height_px=900,
    )


def people():
    kinds = (AgentKind.PEDESTRIAN, AgentKind.CYCLIST, AgentKind.VEHICLE)
    return straight_drivers([(9.0 * x, 0.0, 0.0, 5.0) for x in range(3)], kinds=kinds)


def test_the_scale_of_a_view_from_above():
    view = view_of(75.0)
    assert view.is_from_above
    assert np.allclose(view.up, [0, 1, 0])
    assert view.pixels_per_m(np.zeros((1, 3)))[0] == pytest.approx(6.0)


@pytest.mark.parametrize("half_height_m", [10.0, 65.0, 200.0, 900.0])
def test_people_have_at_least_the_smallest_glyph(half_height_m):
    """Pedestrians were 5 px (D18)."""
    agents, view = people(), view_of(half_height_m)
    drawn = drawn_sizes_m(agents, view)
    pixels = drawn * view.pixels_per_m(np.zeros((1, 3)))[0]
    assert (pixels[:2].max(axis=1) >= MIN_LENGTH_PX - 1e-6).all()
    assert (pixels[:2].min(axis=1) >= MIN_WIDTH_PX - 1e-6).all()
    assert (drawn >= agents.size_m).all()
    assert np.array_equal(drawn[2], agents.size_m[2])


def test_sizes_are_true_in_a_close_view_and_in_3d():
    agents = people()
    assert np.allclose(drawn_sizes_m(agents, view_of(5.0)), agents.size_m)
    assert drawn_sizes_m(agents, view_of(500.0, 1.0)) is agents.size_m
    assert drawn_sizes_m(agents, None) is agents.size_m


def test_a_scale_is_renewed_when_the_zoom_has_changed_by_a_sixth():
    view = view_of(65.0)
    assert not view_of(70.0).differs_from(view)
    assert view_of(78.0).differs_from(view)
    assert view_of(55.0).differs_from(view)
    assert view_of(65.0, 1.0).differs_from(view)
