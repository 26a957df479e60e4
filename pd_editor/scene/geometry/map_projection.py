"""Universal transverse Mercator coordinates of places on the WGS 84 ellipsoid."""

from typing import Final

import numpy as np
from jaxtyping import Float

_EQUATOR_M: Final = 6_378_137.0
_FLATTENING: Final = 1 / 298.257223563
_SCALE: Final = 0.9996
_FALSE_EASTING_M: Final = 500_000.0
_FALSE_NORTHING_M: Final = 10_000_000.0
"""South of the equator."""


def utm_zone(lon_deg: float) -> int:
    """Number of the zone of 6 degrees, without the exceptions of Norway and Svalbard."""
    return int((lon_deg + 180.0) // 6.0) % 60 + 1


def utm(
    lat_deg: Float[np.ndarray, "N"], lon_deg: Float[np.ndarray, "N"], zone: int
) -> Float[np.ndarray, "N 2"]:
    """Easting and northing in metres; exact to 0.1 mm within a zone (Krueger's series).

    The hemisphere is that of the mean latitude.
    """
    lat = np.deg2rad(lat_deg)
    lon = np.deg2rad(lon_deg - (6 * zone - 183))
    n = _FLATTENING / (2 - _FLATTENING)
    radius = _EQUATOR_M / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    series = (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16,
        13 * n**2 / 48 - 3 * n**3 / 5,
        61 * n**3 / 240,
    )
    eccentricity = 2 * np.sqrt(n) / (1 + n)
    sine = np.sin(lat)
    t = np.sinh(
        np.arctanh(sine) - eccentricity * np.arctanh(eccentricity * sine)
    )  # tangent of the conformal latitude
    north = np.arctan2(t, np.cos(lon))
    east = np.arctanh(np.sin(lon) / np.sqrt(1 + t**2))
    x, y = east.copy(), north.copy()
    for order, factor in enumerate(series, start=1):
        x += factor * np.cos(2 * order * north) * np.sinh(2 * order * east)
        y += factor * np.sin(2 * order * north) * np.cosh(2 * order * east)
    start = _FALSE_NORTHING_M if np.mean(lat_deg) < 0 else 0.0
    return np.stack(
        [_FALSE_EASTING_M + _SCALE * radius * x, start + _SCALE * radius * y], axis=-1
    )
