"""Streets: their centre lines, and cross-sections with the statistics of Argoverse 2's cities."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    Strip,
    StripKind,
)
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
) -> tuple[Float[np.ndarray, "M 2"], list[float]]:
    """Smooth line through points, whose directions there are rotated left.

    Also returns the arc lengths of the points between its ends.
    """
    heading = np.arctan2(*np.gradient(points_m, axis=0).T[::-1]) + swing_rad
    ahead = unit_vector(heading)
    parts = [
        between_poses(points_m[k], ahead[k], points_m[k + 1], ahead[k + 1])
        for k in range(len(points_m) - 1)
    ]
    line = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    ends = np.cumsum([len(part) - 1 for part in parts[:-1]], dtype=int)
    return line, arc_length(line)[ends].tolist()


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


@dataclass(frozen=True, kw_only=True)
class Carriageway:
    """Cross-section of one direction of a street: sidewalk, parking, bike, vehicle lanes."""

    num_lanes: int
    lane_width_m: float
    speed_mps: float
    has_bus_lane: bool = False
    """Whether the rightmost vehicle lane is a bus lane."""
    bike_width_m: float = 0.0
    parking_width_m: float = 0.0
    sidewalk_width_m: float = 0.0
    median_m: float = 0.0
    """Width of the median between the two directions."""
    is_one_way: bool = False

    def lanes_only(self, num_lanes: int) -> "Carriageway":
        """So many plain lanes, without anything between them and the kerb."""
        return replace(
            self,
            num_lanes=num_lanes,
            has_bus_lane=False,
            bike_width_m=0.0,
            parking_width_m=0.0,
            sidewalk_width_m=0.0,
        )

    def strips(self) -> tuple[Strip, ...]:
        """Lanes (strips) from the kerb to the left."""
        beside = [
            (StripKind.SIDEWALK, self.sidewalk_width_m),
            (StripKind.PARKING, self.parking_width_m),
            (StripKind.BIKE, self.bike_width_m),
        ]
        lanes = [StripKind.CAR] * self.num_lanes
        if self.has_bus_lane:
            lanes[0] = StripKind.BUS
        return tuple(
            [Strip(kind=kind, width_m=width) for kind, width in beside if width > 0]
            + [Strip(kind=kind, width_m=self.lane_width_m) for kind in lanes]
        )

    def width_m(self) -> float:
        """Total width of all strips."""
        return sum(strip.width_m for strip in self.strips())


_SIDEWALK_M: Final = 2.5
_CORNER_M: Final = 3.3
_CORNER_SPREAD: Final = 0.8
"""Standard deviation of the logarithm of the radius."""


def residential(random: np.random.Generator) -> Carriageway:
    """Sample a residential street: one lane per direction, with parking or wide lanes."""
    parking = _sampled_width(random, 0.6, 2.0, 2.5)
    width = _width(random) if parking else round(float(random.uniform(3.2, 4.6)), 2)
    return Carriageway(
        num_lanes=1,
        lane_width_m=width,
        speed_mps=float(random.uniform(8.5, 12.5)),
        parking_width_m=parking,
        sidewalk_width_m=_SIDEWALK_M,
    )


def collector(random: np.random.Generator) -> Carriageway:
    """Sample a collector: one or two lanes per direction."""
    bike = _sampled_width(random, 0.4, 1.5, 2.0)
    return Carriageway(
        num_lanes=int(random.choice([1, 2], p=[0.6, 0.4])),
        lane_width_m=_width(random),
        speed_mps=float(random.uniform(11.0, 15.0)),
        bike_width_m=bike,
        parking_width_m=_sampled_width(random, 0.15 if bike else 0.55, 2.1, 2.6),
        sidewalk_width_m=_SIDEWALK_M,
    )


def avenue(random: np.random.Generator) -> Carriageway:
    """Sample a main street: two to four lanes per direction, often with a median."""
    medians = [0.0, 0.5, random.uniform(1.5, 3.0), random.uniform(3.8, 5.5)]
    return Carriageway(
        num_lanes=int(random.choice([2, 3, 4], p=[0.6, 0.32, 0.08])),
        lane_width_m=_width(random),
        speed_mps=float(random.uniform(12.0, 18.0)),
        has_bus_lane=bool(random.random() < 0.1),
        bike_width_m=_sampled_width(random, 0.35, 1.5, 2.0),
        parking_width_m=_sampled_width(random, 0.15, 2.2, 2.6),
        sidewalk_width_m=_SIDEWALK_M,
        median_m=round(float(random.choice(medians, p=[0.3, 0.15, 0.15, 0.4])), 2),
    )


def one_way(random: np.random.Generator) -> Carriageway:
    """Sample a one-way street downtown."""
    bike = _sampled_width(random, 0.4, 1.5, 2.0)
    return Carriageway(
        num_lanes=int(random.choice([1, 2, 3, 4], p=[0.2, 0.4, 0.3, 0.1])),
        lane_width_m=_width(random),
        speed_mps=float(random.uniform(10.0, 14.5)),
        has_bus_lane=False,
        bike_width_m=bike,
        parking_width_m=_sampled_width(random, 0.2 if bike else 0.6, 2.1, 2.5),
        sidewalk_width_m=_SIDEWALK_M,
        is_one_way=True,
    )


def control(
    one: Carriageway, two: Carriageway, random: np.random.Generator
) -> NodeKind:
    """Sample the right of way where two streets meet; main streets mostly have signals."""
    fewer, more = sorted((one.num_lanes, two.num_lanes))
    shares = {NodeKind.SIGNALS: 1.0}
    if more == 1:
        shares = {
            NodeKind.ALL_WAY_STOP: 0.25,
            NodeKind.MINOR_STOP: 0.6,
            NodeKind.SIGNALS: 0.15,
        }
    elif fewer == 1:
        shares = {NodeKind.MINOR_STOP: 0.6, NodeKind.SIGNALS: 0.4}
    return list(shares)[random.choice(len(shares), p=list(shares.values()))]


def corner_radius_m(random: np.random.Generator) -> float:
    """Sample the radius of the sidewalk's outer edge at the corners of a junction.

    The radius of the kerb is larger by the sidewalk's width.
    """
    radius = _CORNER_M * np.exp(_CORNER_SPREAD * random.normal())
    # Least and greatest radius.
    return float(np.clip(radius, 2.2, 12.0))


def crossing_width_m(random: np.random.Generator) -> float:
    """Sample the width of pedestrian crossings."""
    return float(random.uniform(3.0, 5.5))


def _width(random: np.random.Generator) -> float:
    width = random.normal(3.3, 0.3)
    return round(float(np.clip(width, 2.75, 4.1)), 2)


def _sampled_width(
    random: np.random.Generator, share: float, least: float, most: float
) -> float:
    width = round(float(random.uniform(least, most)), 2)
    return width if random.random() < share else 0.0
