import numpy as np
import shapely

from pd_editor.viewer.meshes.flat_mesh import Primitive
from pd_editor.viewer.meshes.ribbons import (
    DOT_M,
    dotted,
    motion_m,
    path_heights,
    path_ribbons,
)


def straight(num_paths: int, num_points: int, length_m: float) -> np.ndarray:
    x = np.linspace(0.0, length_m, num_points)
    one = np.stack([x, np.zeros(num_points)], axis=-1)
    return np.broadcast_to(one, (num_paths, num_points, 2)).copy()


def ribbons_of(points: np.ndarray, is_valid: np.ndarray | None = None) -> Primitive:
    count, steps = points.shape[:2]
    return path_ribbons(
        points,
        np.ones((count, steps), bool) if is_valid is None else is_valid,
        color=np.linspace(0, 1, 3 * count).reshape(count, 3),
        opacity=np.full((count, steps), 0.5),
        width_m=np.full((count, steps), 0.4),
        height_m=path_heights(0.07, np.arange(count)),
    )


def test_ribbons_of_different_agents_never_share_a_height():
    """Ribbons on each other flickered through (D15)."""
    ribbons = ribbons_of(straight(150, 31, 60.0))
    height = np.asarray(ribbons.height_m).reshape(150, -1)
    assert (np.ptp(height, axis=1) == 0).all()
    assert np.diff(np.sort(height[:, 0])).min() >= 4.9e-4


def test_a_later_path_is_drawn_wholly_after_an_earlier_one():
    """Interleaved triangles hatched one colour with another (D15)."""
    ribbons = ribbons_of(straight(4, 11, 30.0))
    owner = ribbons.faces[:, 0] // 22
    assert (np.diff(owner) >= 0).all()


def test_a_ribbon_covers_its_path_once():
    ribbons = ribbons_of(straight(1, 7, 12.0))
    triangles = shapely.polygons(ribbons.points_m[ribbons.faces])
    assert np.isclose(shapely.area(triangles).sum(), 12.0 * 0.4)
    assert np.isclose(shapely.union_all(triangles).area, 12.0 * 0.4)


def test_dots_have_one_length_at_any_speed():
    """Agents that come later are dotted (D19)."""
    slow, fast = straight(1, 31, 6.3), straight(1, 31, 90.9)
    points = np.concatenate([slow, fast])
    dots, is_dot = dotted(points, np.ones((2, 31), bool))
    both = is_dot[:, 1:] & is_dot[:, :-1]
    length = np.linalg.norm(np.diff(dots, axis=1), axis=-1)
    assert np.allclose(length[both], DOT_M, atol=1e-6)
    assert both.sum(axis=1).tolist() == [4, 51]


def test_dots_lie_on_the_path_where_it_is_valid():
    points = straight(1, 31, 30.0)
    is_valid = np.arange(31)[None] >= 16
    dots, is_dot = dotted(points, is_valid)
    assert dots[is_dot][:, 0].min() >= 16.0 - 1e-9
    assert dots[is_dot][:, 0].max() <= 30.0 + 1e-9


def test_nothing_to_dot_is_nothing():
    dots, is_dot = dotted(np.zeros((0, 31, 2)), np.zeros((0, 31), bool))
    assert dots.shape == (0, 1, 2)
    assert is_dot.shape == (0, 1)


def test_noise_of_a_parked_car_is_no_motion():
    """Parked cars had scribbles for futures (D19)."""
    noise = np.random.default_rng(4).normal(0.0, 0.25, (20, 30, 2))
    valid = np.ones((20, 30), bool)
    assert (motion_m(noise, valid) < 1.0).all()
    driving = straight(20, 30, 6.0)
    assert (motion_m(driving + noise, valid) > 3.0).all()


def test_motion_ignores_points_that_are_not_there():
    points = straight(1, 30, 60.0)
    points[0, 5:] = 1e6
    is_valid = np.arange(30)[None] < 5
    assert motion_m(points, is_valid)[0] < 10.0
    assert motion_m(points, np.zeros((1, 30), bool))[0] == 0.0
