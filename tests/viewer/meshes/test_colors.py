import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.viewer.meshes.colors import (
    _ACES_INPUT,
    _ACES_OUTPUT,
    LIGHT_ON_ROOFS,
    inverse_aces,
    lit_from_above,
    srgb_to_linear,
)


def aces(linear: np.ndarray) -> np.ndarray:
    """three.js's ACESFilmicToneMapping, written from its shader."""
    v = (linear / 0.6) @ _ACES_INPUT.T
    fitted = (v * (v + 0.0245786) - 0.000090537) / (
        v * (0.983729 * v + 0.4329510) + 0.238081
    )
    return fitted @ _ACES_OUTPUT.T


@given(st.tuples(*[st.floats(0.15, 0.85)] * 3))
def test_inverse_aces_undoes_the_renderers_curve_for_muted_colours(color):
    wanted = np.array(color)
    shown = aces(inverse_aces(wanted))
    assert np.allclose(shown, wanted, atol=0.02) or inverse_aces(wanted).min() == 0.0


def test_greys_come_back_exactly():
    greys = np.linspace(0.01, 0.95, 20)[:, None] * np.ones(3)
    assert np.allclose(aces(inverse_aces(greys)), greys, atol=2e-3)


def test_linear_light_of_known_values():
    assert np.allclose(
        srgb_to_linear(np.array([0.0, 0.5, 1.0])), [0, 0.21404, 1], atol=1e-5
    )


@given(st.tuples(*[st.integers(40, 180)] * 3))
def test_a_lit_roof_appears_in_its_colour(color):
    """Legend, ribbons and roofs of one agent agree (D23)."""
    sent = np.array(lit_from_above(color)) / 255.0
    shown = aces(sent * LIGHT_ON_ROOFS)
    wanted = srgb_to_linear(np.array(color) / 255.0)
    assert np.allclose(shown, wanted, atol=0.03) or min(sent) == 0.0
