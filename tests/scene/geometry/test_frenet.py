import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.frenet import FrenetFrames, mitred_normals

NUM_POINTS = 12


@st.composite
def bending_lines(draw) -> np.ndarray:
    """A line of segments of 2..6 m that bends by at most 20 degrees per vertex."""
    turns = draw(
        st.lists(
            st.floats(-0.35, 0.35), min_size=NUM_POINTS - 1, max_size=NUM_POINTS - 1
        )
    )
    lengths = draw(
        st.lists(st.floats(2, 6), min_size=NUM_POINTS - 1, max_size=NUM_POINTS - 1)
    )
    heading = draw(st.floats(-3, 3)) + np.cumsum(turns)
    steps = np.array(lengths)[:, None] * np.stack(
        [np.cos(heading), np.sin(heading)], -1
    )
    return np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])


@given(bending_lines(), st.floats(-5, 30), st.floats(-1.5, 1.5))
def test_there_and_back(line, s, d):
    frames = FrenetFrames(points_m=line[None])
    point = frames.to_plane(np.array([[s]]), np.array([[d]]))
    s_back, d_back = frames.to_frenet(point)
    again = frames.to_plane(s_back, d_back)
    # A line may come back close to itself; the nearer solution is then the right one.
    assert abs(d_back[0, 0]) <= abs(d) + 1e-6
    assert np.allclose(again, point, atol=1e-6)
    if abs(d_back[0, 0] - d) < 1e-6:
        assert s_back[0, 0] == pytest.approx(s, abs=1e-6)


@given(bending_lines(), st.floats(0.2, 1.5))
def test_offset_lines_run_parallel(line, d):
    frames = FrenetFrames(points_m=line[None])
    offset = frames.to_plane(frames.along_m, np.full((1, NUM_POINTS), d))[0]
    across = np.diff(offset, axis=0)
    along = np.diff(line, axis=0)
    cross = across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]
    assert np.allclose(cross, 0.0, atol=1e-6)


def test_straight_line_gives_x_and_y():
    line = np.array([[0.0, 0.0], [4.0, 0.0], [10.0, 0.0]])
    points = np.array([[-3.0, 1.0], [2.0, -1.5], [4.0, 2.0], [12.0, 0.5]])
    s, d = FrenetFrames(points_m=line[None]).to_frenet(points[None])
    assert np.allclose(s[0], points[:, 0])
    assert np.allclose(d[0], points[:, 1])


def test_lines_of_a_batch_do_not_mix_and_padding_changes_nothing():
    short = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]])
    long = np.array([[0.0, 3.0], [3.0, 3.0], [6.0, 4.0], [9.0, 6.0], [9.0, 12.0]])
    padded = np.concatenate([short, np.repeat(short[-1:], 2, axis=0)])
    points = np.random.default_rng(0).uniform(-1, 9, (20, 2))
    both = FrenetFrames(points_m=np.stack([padded, long]))
    s, d = both.to_frenet(np.stack([points, points]))
    for row, line in enumerate((short, long)):
        alone = FrenetFrames(points_m=line[None])
        s_alone, d_alone = alone.to_frenet(points[None])
        assert np.allclose(s[row], s_alone[0])
        assert np.allclose(d[row], d_alone[0])
        back = both.to_plane(s, d)[row]
        assert np.allclose(back, alone.to_plane(s_alone, d_alone)[0])


def test_mitre_of_a_sharp_corner_is_cut():
    hairpin = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 0.1]])
    assert np.linalg.norm(mitred_normals(hairpin), axis=-1).max() <= 2.0
