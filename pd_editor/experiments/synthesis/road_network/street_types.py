"""Cross-sections of streets, sampled with the statistics of Argoverse 2's cities."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    Strip,
    StripKind,
)


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


_LANE_WIDTH_M: Final = 3.3
_LANE_SPREAD_M: Final = 0.3
_LANE_WIDTHS_M: Final = (2.75, 4.1)
_SIDEWALK_M: Final = 2.5
_CORNER_M: Final = 3.3
_CORNER_SPREAD: Final = 0.8
"""Standard deviation of the logarithm of the radius."""
_CORNERS_M: Final = (2.2, 12.0)
"""Least and greatest radius."""


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
    return float(np.clip(radius, *_CORNERS_M))


def crossing_width_m(random: np.random.Generator) -> float:
    """Sample the width of pedestrian crossings."""
    return float(random.uniform(3.0, 5.5))


def _width(random: np.random.Generator) -> float:
    width = random.normal(_LANE_WIDTH_M, _LANE_SPREAD_M)
    return round(float(np.clip(width, *_LANE_WIDTHS_M)), 2)


def _sampled_width(
    random: np.random.Generator, share: float, least: float, most: float
) -> float:
    width = round(float(random.uniform(least, most)), 2)
    return width if random.random() < share else 0.0
