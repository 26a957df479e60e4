import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.angles import (
    heading_of,
    interpolate_angle,
    left_of,
    unit_vector,
    wrap_angle,
)

ANGLES = st.floats(-1e3, 1e3)


@given(ANGLES)
def test_wrapping_keeps_the_direction_and_lands_in_the_half_open_range(angle):
    wrapped = wrap_angle(np.array([angle]))[0]
    assert -np.pi < wrapped <= np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-9)


def test_half_a_turn_stays_positive():
    np.testing.assert_allclose(wrap_angle(np.array([np.pi, -np.pi])), np.pi)


@given(st.floats(-3.1, 3.1))
def test_heading_inverts_unit_vector_and_left_is_a_quarter_turn(angle):
    vector = unit_vector(np.array([angle]))
    np.testing.assert_allclose(heading_of(vector), angle, atol=1e-12)
    turned = heading_of(left_of(vector))
    np.testing.assert_allclose(wrap_angle(turned - angle), np.pi / 2, atol=1e-12)


@given(ANGLES, st.floats(-3, 3), st.floats(0, 1))
def test_interpolation_goes_the_short_way_round(start, turn, fraction):
    between = interpolate_angle(
        np.array([start]), np.array([start + turn]), np.array([fraction])
    )
    np.testing.assert_allclose(
        wrap_angle(between - start - fraction * turn), 0, atol=1e-9
    )
