"""Colours as authored, through a renderer that tone-maps everything.

viser's client applies the ACES filmic curve of three.js to every surface. Colours
meant to appear exactly are therefore sent through its inverse.
"""

import functools
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.palette import Rgb

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
LIGHT_ON_ROOFS: Final = 1.37
"""Light that a level surface reflects under the editor's lights, read off pictures."""


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
    # three.js divides exposure by this to match a reference renderer.
    return np.maximum(exposed, 0.0) * 0.6


def shown_exactly(color: Rgb) -> tuple[float, float, float]:
    """Material colour that appears as ``color`` on an unlit surface."""
    red, green, blue = inverse_aces(srgb_to_linear(np.array(color) / 255.0))
    return float(red), float(green), float(blue)


@functools.cache
def lit_from_above(color: Rgb) -> Rgb:
    """Colour for viser's batched meshes whose roofs then appear as ``color``.

    Batched meshes take their colours as linear light, and are lit.
    """
    lit = inverse_aces(srgb_to_linear(np.array(color) / 255.0)) / LIGHT_ON_ROOFS
    red, green, blue = np.clip(np.round(lit * 255), 0, 255)
    return int(red), int(green), int(blue)
