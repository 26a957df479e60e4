import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pd_editor.base.errors import EditError
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpTerm

POWERS = st.floats(-10, 10).map(lambda value: round(value, 2))
TERMS = st.fixed_dictionaries(
    {
        "kind": st.sampled_from(list(DEFAULT_LENGTH_M)),
        "power": POWERS,
        "length_m": st.floats(5, 100),
        "border_m": st.floats(0, 20),
        "exponent": st.floats(2.5, 5),
    }
)
ANCHORS = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1))
WARPS = st.tuples(ANCHORS, st.lists(TERMS, min_size=1, max_size=3))
POINTS = st.lists(
    st.tuples(st.floats(-150, 150), st.floats(-150, 150)), min_size=1, max_size=10
).map(np.array)


def warp_of(drawn):
    """Built inside the test: its run-time checks may not run while values are drawn."""
    (x, y, angle), terms = drawn
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=angle)
    return RoadWarp(anchor=anchor, terms=tuple(WarpTerm(**term) for term in terms))


def one(kind, power, **fields):
    term = WarpTerm(kind=kind, power=power, length_m=DEFAULT_LENGTH_M[kind], **fields)
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    return RoadWarp(anchor=anchor, terms=(term,))


def edges(warp):
    """Places where the second derivative jumps."""
    for term in warp.terms:
        yield from (term.border_m, term.border_m + term.length_m)
        yield from (term.border_m + 10, term.border_m + term.length_m + 10)


def test_smooth_turn_in_closed_form():
    # Scene-Attack: a = P / 3000, f = a u^3 up to u = 10, then its tangent.
    x, power = np.linspace(-10, 40, 501), 6.0
    u, a = np.maximum(x - 5, 0), power / 3000
    wanted = np.where(u < 10, a * u**3, 3 * a * 100 * u - 2 * a * 1000)
    np.testing.assert_allclose(
        one("smooth-turn", power).derivative(x, 0), wanted, atol=1e-12
    )


def test_double_turn_shifts_the_road_by_its_power():
    x, power = np.linspace(-10, 60, 701), -4.0
    smooth = one("smooth-turn", power)
    wanted = smooth.derivative(x, 0) - smooth.derivative(x - 10, 0)
    warp = one("double-turn", power)
    np.testing.assert_allclose(warp.derivative(x, 0), wanted, atol=1e-12)
    np.testing.assert_allclose(warp.derivative(np.array([25.0, 90]), 0), power)


def test_ripple_in_closed_form():
    x, power = np.linspace(-10, 200, 501), 3.0
    u = np.maximum(x - 5, 0)
    wanted = power * (1 - np.cos(2 * np.pi * u / 60))
    np.testing.assert_allclose(
        one("ripple-road", power).derivative(x, 0), wanted, atol=1e-12
    )


@given(WARPS, st.floats(-20, 150))
def test_derivatives_agree_with_finite_differences(drawn, x):
    warp = warp_of(drawn)
    step = 1e-4
    assume(all(abs(x - edge) > 2 * step for edge in edges(warp)))
    near = np.array([x - step, x + step])
    for order in (0, 1):
        low, high = warp.derivative(near, order)
        exact = warp.derivative(np.array([x]), order + 1)[0]
        np.testing.assert_allclose(
            (high - low) / (2 * step), exact, atol=2e-5 * (1 + abs(exact))
        )


@given(WARPS, POINTS)
def test_undo_inverts_apply(drawn, points):
    warp = warp_of(drawn)
    np.testing.assert_allclose(warp.undo(warp.apply(points)), points, atol=1e-9)
    np.testing.assert_allclose(warp.apply(warp.undo(points)), points, atol=1e-9)


@given(WARPS, POINTS)
def test_behind_the_border_nothing_moves_by_a_single_bit(drawn, points):
    warp = warp_of(drawn)
    behind = points[warp.distance_ahead(points) < warp.border_m()]
    np.testing.assert_array_equal(warp.apply(behind), behind)
    np.testing.assert_array_equal(warp.turn(behind, behind), behind)


@given(WARPS, POINTS, st.floats(-3, 3))
def test_turned_vectors_are_differences_of_warped_points(drawn, points, angle):
    warp = warp_of(drawn)
    x = warp.distance_ahead(points)
    assume(all(np.abs(x - edge).min() > 1e-3 for edge in edges(warp)))
    vector = np.broadcast_to([np.cos(angle), np.sin(angle)], points.shape)
    step = 1e-5
    difference = warp.apply(points + step * vector) - warp.apply(points - step * vector)
    np.testing.assert_allclose(
        warp.turn(points, vector), difference / (2 * step), atol=1e-3
    )
    back = warp.turn(points, warp.turn(points, vector), -1.0)
    np.testing.assert_allclose(back, vector, atol=1e-9)


@given(WARPS, POINTS)
def test_distance_ahead_is_the_same_before_and_after(drawn, points):
    warp = warp_of(drawn)
    np.testing.assert_allclose(
        warp.distance_ahead(warp.apply(points)), warp.distance_ahead(points), atol=1e-9
    )


def test_border_is_that_of_the_first_term_that_bends():
    terms = tuple(
        WarpTerm(kind="ripple-road", power=power, length_m=60, border_m=border)
        for power, border in ((0.0, 1.0), (2.0, 30.0), (1.0, 8.0))
    )
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    assert RoadWarp(anchor=anchor, terms=terms).border_m() == 8.0
    assert RoadWarp(anchor=anchor, terms=terms).extent_m() == 90.0
    assert RoadWarp(anchor=anchor, terms=terms[:1]).is_identity


@pytest.mark.parametrize(
    "fields",
    [
        {"power": 11.0},
        {"power": float("nan")},
        {"length_m": 0.0},
        {"border_m": -1.0},
        {"exponent": 1.0},
    ],
)
def test_odd_numbers_are_refused_in_words(fields):
    good = {"kind": "smooth-turn", "power": 3.0, "length_m": 10.0}
    with pytest.raises(EditError):
        WarpTerm(**{**good, **fields})
