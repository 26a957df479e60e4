import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.rigid_motion import RigidMotion

NUMBERS = st.floats(-100, 100)
MOTIONS = st.builds(
    RigidMotion, x_m=NUMBERS, y_m=NUMBERS, rotation_rad=st.floats(-3.1, 3.1)
)
POINTS = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=5).map(np.array)


@given(MOTIONS, POINTS)
def test_inverse_undoes(motion, points):
    back = motion.inverse().apply(motion.apply(points))
    np.testing.assert_allclose(back, points, atol=1e-9)


@given(MOTIONS, MOTIONS, POINTS)
def test_after_is_composition(second, first, points):
    np.testing.assert_allclose(
        second.after(first).apply(points), second.apply(first.apply(points)), atol=1e-9
    )


@given(MOTIONS, POINTS)
def test_vectors_turn_as_differences_of_points_do(motion, points):
    origin = np.zeros(2)
    np.testing.assert_allclose(
        motion.turn(points), motion.apply(points) - motion.apply(origin), atol=1e-9
    )


@given(MOTIONS, POINTS)
def test_agrees_with_complex_numbers(motion, points):
    z = points[:, 0] + 1j * points[:, 1]
    moved = z * np.exp(1j * motion.rotation_rad) + motion.x_m + 1j * motion.y_m
    np.testing.assert_allclose(
        motion.apply(points), np.stack([moved.real, moved.imag], axis=-1), atol=1e-9
    )
