import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from pd_editor.scene.geometry.polyline import (
    arc_length,
    densify,
    offset_line,
    point_at,
    resample,
    smoothed,
    ways_of_bounds,
    without_repeats,
)

NUMBERS = st.floats(-50, 50).map(lambda value: round(value, 3))
LINES = (
    st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=8)
    .map(np.array)
    .filter(lambda line: (np.linalg.norm(np.diff(line, axis=0), axis=1) > 0.01).all())
)


@given(LINES)
def test_length_is_that_of_shapely(line):
    np.testing.assert_allclose(arc_length(line)[-1], shapely.LineString(line).length)


@given(LINES, st.floats(-0.2, 1.2))
def test_point_at_is_shapelys_interpolation(line, fraction):
    distance = fraction * arc_length(line)[-1]
    wanted = shapely.LineString(line).interpolate(max(distance, 0.0))
    np.testing.assert_allclose(
        point_at(line, np.array([distance]))[0], [wanted.x, wanted.y], atol=1e-6
    )


@given(LINES, st.floats(0.5, 20))
def test_densify_keeps_every_point_and_the_shape(line, spacing):
    dense = densify(line, spacing)
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max() <= spacing + 1e-9
    kept = {tuple(point) for point in dense}
    assert all(tuple(point) in kept for point in line)
    np.testing.assert_allclose(arc_length(dense)[-1], arc_length(line)[-1])


def test_densify_interpolates_elevation():
    dense = densify(np.array([[0.0, 0, 0], [4, 0, 2]]), 2.0)
    np.testing.assert_allclose(dense, [[0, 0, 0], [2, 0, 1], [4, 0, 2]])


@given(LINES, st.integers(2, 20))
def test_resample_keeps_both_ends(line, count):
    points = resample(line, count)
    assert len(points) == count
    np.testing.assert_allclose(points[[0, -1]], line[[0, -1]], atol=1e-9)


def test_repeats_are_dropped_and_one_point_stays():
    line = np.array([[0.0, 0], [0, 0], [1, 0], [1, 0]])
    np.testing.assert_array_equal(without_repeats(line), [[0, 0], [1, 0]])
    assert len(without_repeats(np.zeros((3, 2)))) == 1


@given(LINES, st.floats(0.3, 5.0))
def test_smoothing_is_scipys_gaussian_filter(line, width):
    dense = resample(line, 40)
    expected = gaussian_filter1d(
        dense, width, axis=0, mode="nearest", radius=int(np.ceil(4 * width))
    )
    np.testing.assert_allclose(smoothed(dense, width), expected, atol=1e-9)


def test_offset_of_a_circle_is_a_circle():
    angle = np.linspace(0, 2, 400)
    circle = 20 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    radius = np.linalg.norm(offset_line(circle, 3.0), axis=1)
    np.testing.assert_allclose(radius, 17.0, atol=1e-3)


@given(LINES)
def test_offset_is_never_further_than_twice_the_distance(line):
    moved = np.linalg.norm(offset_line(line, 1.5) - line, axis=1)
    assert moved.max() <= 3.0 * np.sqrt(2) + 1e-9


def test_inner_bounds_of_tight_turns_are_not_turned_round():
    """Exported U-turns came back with their inner bounds, and so their middles, moved."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 9)
    outer = 3.2 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for inner in ([[0, 0.3], [0.4, 0], [0, -0.3]], [[0, 0.01], [0, -0.01]]):
        assert ways_of_bounds(np.array(inner, float), outer) == (1, 1)
    street = np.array([[0.0, 0], [4, 0]])
    beside = street - [0, 3.5]
    assert ways_of_bounds(street, beside[::-1]) == (1, -1)
    assert ways_of_bounds(street[::-1], beside) == (-1, 1)
