"""Transverse Mercator coordinates of places on the WGS 84 ellipsoid."""

import re
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


def projected(
    told: str, lat_deg: Float[np.ndarray, "N"], lon_deg: Float[np.ndarray, "N"]
) -> Float[np.ndarray, "N 2"] | None:
    """Places in the projection that a text in the form of PROJ or EPSG tells.

    None unless that is UTM or transverse Mercator.
    """
    code = re.search(r"(?i)epsg:\s*(?:326|327|258)(\d\d)", told)
    given = dict(re.findall(r"\+(\w+)=([\w.+-]+)", told))
    if code or (given.get("proj") == "utm" and "zone" in given):
        return utm(lat_deg, lon_deg, int(code[1] if code else given["zone"]))
    if given.get("proj") != "tmerc":
        return None
    lat, lon, east, north = (
        float(given.get(name, 0)) for name in ("lat_0", "lon_0", "x_0", "y_0")
    )
    start = _on_meridian(np.array([lat]), np.array([lon]), lon)
    scale = float(given.get("k", given.get("k_0", 1)))
    moved = _on_meridian(lat_deg, lon_deg, lon) - start
    return scale * moved + np.array([east, north])


def utm(
    lat_deg: Float[np.ndarray, "N"], lon_deg: Float[np.ndarray, "N"], zone: int
) -> Float[np.ndarray, "N 2"]:
    """Easting and northing in metres; exact to 0.1 mm within a zone (Krueger's series).

    The hemisphere is that of the mean latitude.
    """
    start = _FALSE_NORTHING_M if np.mean(lat_deg) < 0 else 0.0
    found = _SCALE * _on_meridian(lat_deg, lon_deg, 6 * zone - 183)
    return found + np.array([_FALSE_EASTING_M, start])


def _on_meridian(
    lat_deg: Float[np.ndarray, "N"], lon_deg: Float[np.ndarray, "N"], middle_deg: float
) -> Float[np.ndarray, "N 2"]:
    """Metres east of a meridian, and north of the equator."""
    lat = np.deg2rad(lat_deg)
    lon = np.deg2rad(lon_deg - middle_deg)
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
    return radius * np.stack([x, y], axis=-1)
