"""Streets as they are found in the cities of Argoverse 2, drawn at random."""

from typing import Final

import numpy as np

from pd_editor.synthesis.street import Carriageway

_LANE_WIDTHS_M: Final = (3.0, 3.7)
_SIDEWALK_M: Final = 2.5


def residential(random: np.random.Generator) -> Carriageway:
    """A quiet street of one lane a direction, mostly with room to park."""
    return Carriageway(
        num_lanes=1,
        lane_width_m=_width(random),
        speed_mps=float(random.uniform(8.0, 11.5)),
        parking_width_m=_drawn(random, 0.6, 2.0, 2.5),
        sidewalk_width_m=_SIDEWALK_M,
    )


def collector(random: np.random.Generator) -> Carriageway:
    """A through street of one or two lanes a direction."""
    return Carriageway(
        num_lanes=int(random.choice([1, 2], p=[0.6, 0.4])),
        lane_width_m=_width(random),
        speed_mps=float(random.uniform(10.0, 14.0)),
        bike_width_m=_drawn(random, 0.35, 1.5, 2.0),
        parking_width_m=_drawn(random, 0.4, 2.1, 2.6),
        sidewalk_width_m=_SIDEWALK_M,
    )


def avenue(random: np.random.Generator) -> Carriageway:
    """A main street of two to four lanes a direction."""
    return Carriageway(
        num_lanes=int(random.choice([2, 3, 4], p=[0.55, 0.35, 0.1])),
        lane_width_m=_width(random),
        speed_mps=float(random.uniform(11.5, 17.0)),
        has_bus_lane=bool(random.random() < 0.12),
        bike_width_m=_drawn(random, 0.3, 1.5, 2.0),
        parking_width_m=_drawn(random, 0.15, 2.2, 2.6),
        sidewalk_width_m=_SIDEWALK_M,
    )


def median_m(random: np.random.Generator) -> float:
    """Width between the directions of a main street: paint, or an island."""
    return float(random.choice([0.0, 0.5, random.uniform(1.5, 4.0)], p=[0.4, 0.3, 0.3]))


def _width(random: np.random.Generator) -> float:
    return round(float(random.uniform(*_LANE_WIDTHS_M)), 2)


def _drawn(
    random: np.random.Generator, share: float, least: float, most: float
) -> float:
    width = round(float(random.uniform(least, most)), 2)
    return width if random.random() < share else 0.0
