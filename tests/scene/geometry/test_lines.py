import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.lines import Lines, numbered
from pd_editor.scene.geometry.polyline import (
    arc_length,
    densify,
    offset_line,
    point_at,
    without_repeats,
)
from tests.scene.geometry.test_polyline import LINES

REPEATED = LINES.map(lambda line: np.repeat(line, 2, axis=0))
MANY = st.lists(LINES | REPEATED, max_size=5)


def same(found, expected):
    assert len(found.count) == len(expected)
    for one, other in zip(found.apart(), expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@given(MANY, st.floats(0.5, 20))
def test_many_lines_are_changed_as_one_by_one(lines, number):
    together = Lines.of(lines)
    same(together, lines)
    same(together.densified(number), [densify(line, number) for line in lines])
    bare = [without_repeats(line) for line in lines]
    same(together.without_repeats(), bare)
    same(Lines.of(bare).offset(number), [offset_line(line, number) for line in bare])
    short = np.array([len(line) < 5 for line in lines], bool)
    same(together.taken(short), [line for line in lines if len(line) < 5])
    np.testing.assert_allclose(
        together.length_m, [arc_length(line)[-1] for line in lines], atol=1e-9
    )


@given(MANY, st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=5))
def test_points_are_those_at_distances_along_each_line(lines, shares):
    together = Lines.of(lines)
    owner = np.repeat(np.arange(len(lines)), len(shares))
    distance = np.tile(shares, len(lines)) * together.length_m[owner]
    found = together.at(owner, distance).reshape(len(lines), len(shares), 2)
    for line, points, at in zip(
        lines, found, distance.reshape(found.shape[:2]), strict=True
    ):
        np.testing.assert_allclose(points, point_at(line, at), atol=1e-8)


@given(st.lists(LINES | st.just(np.zeros((0, 2))), max_size=5), st.floats(0.5, 20))
def test_empty_lines_stay_empty(lines, spacing):
    dense = Lines.of(lines).densified(spacing)
    assert [len(line) > 0 for line in dense.apart()] == [
        len(line) > 0 for line in lines
    ]


@given(st.lists(st.integers(0, 4)))
def test_numbers_count_from_zero_within_each_owner(count):
    owner, number = numbered(np.array(count, int))
    expected = [(row, one) for row, many in enumerate(count) for one in range(many)]
    assert list(zip(owner.tolist(), number.tolist(), strict=True)) == expected
