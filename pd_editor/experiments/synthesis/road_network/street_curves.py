"""Centre lines of streets: straight lines, arcs, S-curves, clothoids."""

from collections.abc import Callable
from enum import StrEnum
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.polyline import arc_length, point_at

SPACING_M: Final = 3.0
"""Distance between the points of a curve."""


class CurveKind(StrEnum):
    """Profile of curvature along a curve."""

    STRAIGHT = "straight"
    ARC = "arc"
    S_CURVE = "s-curve"
    CLOTHOID = "clothoid"
    """Curvature increases linearly to the middle and decreases again."""


_CURVATURE: Final[
    dict[CurveKind, Callable[[Float[np.ndarray, "N"]], Float[np.ndarray, "N"]]]
] = {
    CurveKind.STRAIGHT: np.zeros_like,
    CurveKind.ARC: np.ones_like,
    CurveKind.S_CURVE: lambda s: np.pi * np.sin(2 * np.pi * s),
    CurveKind.CLOTHOID: lambda s: 2.0 - 4.0 * np.abs(s - 0.5),
}
"""Curvature over the fraction of the length; its integral, or that of half an S-curve,
is one."""


_SHARE: Final = {
    CurveKind.STRAIGHT: 0.7,
    CurveKind.ARC: 0.1,
    CurveKind.S_CURVE: 0.08,
    CurveKind.CLOTHOID: 0.12,
}
"""Share of each kind; most streets of Argoverse 2's cities are straight."""


def sample_curve_kind(random: np.random.Generator) -> CurveKind:
    """Sample a kind of curve with the frequencies of streets."""
    return list(_SHARE)[random.choice(len(_SHARE), p=list(_SHARE.values()))]


def curve(
    start_m: Float[np.ndarray, "2"],
    end_m: Float[np.ndarray, "2"],
    kind: CurveKind,
    turn_rad: float,
) -> Float[np.ndarray, "N 2"]:
    """Curve between two points that turns left by an angle in total.

    An S-curve turns by that angle to the left and back.
    """
    chord = end_m - start_m
    count = max(int(np.ceil(np.linalg.norm(chord) * 1.2 / SPACING_M)) + 1, 2)
    fine = np.linspace(0.0, 1.0, 16 * count)
    rate = turn_rad * _CURVATURE[kind](fine)
    heading = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2)])
    heading /= len(fine) - 1
    step = np.exp(1j * (heading[1:] + heading[:-1]) / 2)
    line = np.concatenate([[0.0], np.cumsum(step)])
    line = line * (complex(*chord) / line[-1])
    at = np.interp(np.linspace(0, 1, count), fine, np.arange(len(fine)))
    x = start_m[0] + np.interp(at, np.arange(len(fine)), line.real)
    y = start_m[1] + np.interp(at, np.arange(len(fine)), line.imag)
    return np.stack([x, y], axis=-1)


def between_poses(
    start_m: Float[np.ndarray, "2"],
    start_direction: Float[np.ndarray, "2"],
    end_m: Float[np.ndarray, "2"],
    end_direction: Float[np.ndarray, "2"],
) -> Float[np.ndarray, "N 2"]:
    """Cubic curve between two points with given unit directions."""
    reach = float(np.linalg.norm(end_m - start_m))
    t = np.linspace(0.0, 1.0, max(int(np.ceil(reach * 1.2 / SPACING_M)) + 1, 6))[
        :, None
    ]
    return (
        (2 * t**3 - 3 * t**2 + 1) * start_m
        + (t**3 - 2 * t**2 + t) * reach * start_direction
        + (3 * t**2 - 2 * t**3) * end_m
        + (t**3 - t**2) * reach * end_direction
    )


def direction(points_m: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "2"]:
    """Unit vector from the first point to the last."""
    step = points_m[-1] - points_m[0]
    return step / np.linalg.norm(step)


def pose_at(
    line_m: Float[np.ndarray, "N 2"], along_m: float, reach_m: float = 2.0
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Point of a line, and its direction there, over some way before and after."""
    points = point_at(line_m, along_m + np.array([-reach_m, 0.0, reach_m]))
    return points[1], direction(points)


def sample_main_line(
    random: np.random.Generator,
    length_m: tuple[float, float],
    first_m: tuple[float, float],
    gap_m: tuple[float, float],
    end_m: float,
) -> tuple[Float[np.ndarray, "N 2"], list[float]]:
    """Line of a road, and arc lengths of its junctions, none near its end."""
    angle = float(random.uniform(0, 2 * np.pi))
    reach = float(random.uniform(*length_m)) * unit_vector(angle)
    kind = sample_curve_kind(random)
    line = curve(np.zeros(2), reach, kind, float(random.uniform(-0.9, 0.9)))
    at, place = [], float(random.uniform(*first_m))
    while place < arc_length(line)[-1] - end_m:
        at.append(place)
        place += float(random.uniform(*gap_m))
    return line, at


def through_points(
    points_m: Float[np.ndarray, "N 2"], swing_rad: Float[np.ndarray, "N"]
) -> list[Float[np.ndarray, "_ 2"]]:
    """Smooth line through points, as parts; its directions there are rotated left."""
    heading = np.arctan2(*np.gradient(points_m, axis=0).T[::-1]) + swing_rad
    ahead = unit_vector(heading)
    return [
        between_poses(points_m[k], ahead[k], points_m[k + 1], ahead[k + 1])
        for k in range(len(points_m) - 1)
    ]


def random_warp(
    random: np.random.Generator, amplitude_m: float
) -> Callable[[Float[np.ndarray, "N 2"]], Float[np.ndarray, "N 2"]]:
    """Sample a smooth warp of the plane with wavelengths of 300-600 m."""
    waves = 4
    angle = random.uniform(0, 2 * np.pi, waves)
    number = 2 * np.pi / random.uniform(300, 600, waves)
    wave = np.stack([np.cos(angle), np.sin(angle)]) * number
    phase = random.uniform(0, 2 * np.pi, waves)
    push = random.normal(0.0, amplitude_m / np.sqrt(waves), (waves, 2))

    def bend(points_m: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
        return points_m + np.sin(points_m @ wave + phase) @ push

    return bend
