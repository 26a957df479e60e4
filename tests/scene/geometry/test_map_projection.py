"""UTM coordinates against places that surveyors know, and a law of lengths."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.map_projection import utm, utm_zone


@pytest.mark.parametrize(
    ("lat", "lon", "zone", "easting", "northing"),
    [
        # Values of PROJ 9 for the WGS 84 ellipsoid.
        (48.16710551136434, 11.579892387343648, 32, 691_818.9679, 5_338_092.3534),
        (-33.8568, 151.2153, 56, 334_900.5697, 6_252_288.7529),
        (0.001, 3.0, 31, 500_000.0, 110.5300),
    ],
)
def test_known_places(
    lat: float, lon: float, zone: int, easting: float, northing: float
):
    assert utm_zone(lon) == zone
    found = utm(np.array([lat]), np.array([lon]), zone)
    np.testing.assert_allclose(found, [[easting, northing]], atol=1e-3)


@given(st.floats(-80, 80), st.floats(-3, 3))
def test_angles_are_kept_and_scales_are_near_one(lat: float, from_middle: float):
    """A small square becomes a small square: the projection is conformal."""
    step = 1e-5
    points = utm(
        np.array([lat, lat + step, lat]),
        9.0 + from_middle + np.array([0.0, 0.0, step]),
        32,
    )
    north, east = points[1] - points[0], points[2] - points[0]
    assert abs(north @ east) < 1e-4 * np.hypot(*north) * np.hypot(*east)
    # Metres of a degree along the meridian of WGS 84.
    wave = np.deg2rad(2 * lat)
    degree = 111_132.954 - 559.822 * np.cos(wave) + 1.175 * np.cos(2 * wave)
    assert np.hypot(*north) == pytest.approx(degree * step, rel=2e-3)
