"""Colours as authored, through a renderer that tone-maps everything.

viser's client applies the ACES filmic curve of three.js to every surface. Colours
meant to appear exactly are therefore sent through its inverse.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_kind import AgentKind

Rgb = tuple[int, int, int]

_ACES_INPUT: Final = np.array(
    [
        [0.59719, 0.35458, 0.04823],
        [0.07600, 0.90834, 0.01566],
        [0.02840, 0.13383, 0.83777],
    ]
)
_ACES_OUTPUT: Final = np.array(
    [
        [1.60475, -0.53108, -0.07367],
        [-0.10208, 1.10813, -0.00605],
        [-0.00327, -0.07276, 1.07602],
    ]
)
_EXPOSURE_DIVISOR: Final = 0.6
"""three.js divides exposure by this to match a reference renderer."""


def srgb_to_linear(
    srgb: Float[np.ndarray, "*shape 3"],
) -> Float[np.ndarray, "*shape 3"]:
    """Linear light of sRGB values in 0..1 (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def inverse_aces(
    linear: Float[np.ndarray, "*shape 3"],
) -> Float[np.ndarray, "*shape 3"]:
    """Linear values that the ACES curve of three.js maps to the ones given."""
    y = np.clip(linear @ np.linalg.inv(_ACES_OUTPUT).T, 0.0, 0.999)
    a = 1 - 0.983729 * y
    b = 0.0245786 - 0.4329510 * y
    c = -(0.000090537 + 0.238081 * y)
    fitted = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    exposed = fitted @ np.linalg.inv(_ACES_INPUT).T
    return np.maximum(exposed, 0.0) * _EXPOSURE_DIVISOR


def shown_exactly(color: Rgb) -> tuple[float, float, float]:
    """Material colour that appears as ``color`` on an unlit surface."""
    red, green, blue = inverse_aces(srgb_to_linear(np.array(color) / 255.0))
    return float(red), float(green), float(blue)


def linearised(color: Rgb) -> Rgb:
    """Colour for viser's batched meshes, which take theirs as linear light."""
    red, green, blue = np.round(srgb_to_linear(np.array(color) / 255.0) * 255)
    return int(red), int(green), int(blue)


@dataclass(frozen=True, kw_only=True)
class Palette:
    """Colours of one theme."""

    ground: Rgb
    road: Rgb
    lane: Rgb
    intersection: Rgb
    bike_lane: Rgb
    bus_lane: Rgb
    lane_edge: Rgb
    centerline: Rgb
    white_paint: Rgb
    yellow_paint: Rgb
    crosswalk: Rgb
    ghost: Rgb
    past: Rgb
    glass: Rgb


LIGHT: Final = Palette(
    ground=(238, 240, 243),
    road=(205, 209, 215),
    lane=(213, 217, 222),
    intersection=(205, 209, 215),
    bike_lane=(197, 214, 203),
    bus_lane=(219, 207, 203),
    lane_edge=(190, 195, 203),
    centerline=(120, 140, 170),
    white_paint=(255, 255, 255),
    yellow_paint=(236, 184, 52),
    crosswalk=(245, 246, 248),
    ghost=(130, 110, 190),
    past=(110, 118, 130),
    glass=(38, 44, 54),
)
DARK: Final = Palette(
    ground=(24, 27, 33),
    road=(40, 46, 56),
    lane=(46, 52, 63),
    intersection=(40, 46, 56),
    bike_lane=(42, 62, 54),
    bus_lane=(66, 51, 52),
    lane_edge=(64, 71, 84),
    centerline=(110, 135, 175),
    white_paint=(222, 226, 232),
    yellow_paint=(226, 176, 60),
    crosswalk=(170, 176, 186),
    ghost=(150, 130, 220),
    past=(140, 148, 160),
    glass=(14, 17, 22),
)

KIND_COLOR: Final[dict[AgentKind, Rgb]] = {
    AgentKind.VEHICLE: (58, 110, 200),
    AgentKind.BUS: (36, 62, 140),
    AgentKind.MOTORCYCLIST: (124, 84, 190),
    AgentKind.CYCLIST: (32, 150, 90),
    AgentKind.PEDESTRIAN: (214, 72, 122),
    AgentKind.STATIC: (150, 156, 166),
    AgentKind.BACKGROUND: (166, 172, 180),
    AgentKind.CONSTRUCTION: (222, 140, 40),
    AgentKind.RIDERLESS_BICYCLE: (110, 160, 130),
    AgentKind.UNKNOWN: (150, 156, 166),
}
FOCAL_COLOR: Final[Rgb] = (240, 112, 24)
EGO_COLOR: Final[Rgb] = (0, 158, 150)
SELECTION_COLOR: Final[Rgb] = (255, 196, 0)
WARNING_COLOR: Final[Rgb] = (225, 36, 36)
CANDIDATE_COLOR: Final[Rgb] = (16, 150, 130)
