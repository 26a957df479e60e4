"""What is drawn of a road seen from above, from the ground up."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pd_editor.scene.crosswalk_stripes import crosswalk_stripes
from pd_editor.scene.lane_marks import marked_lines
from pd_editor.scene.road_map import LaneKind, RoadMap


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadLayer:
    """Areas or lines that look alike."""

    color_name: str
    """A field of ``palette.Palette``."""
    lines: Sequence[np.ndarray]
    """Points of each line or ring, N x 2 or N x 3."""
    width_m: float | None = None
    """Width of lines; None: rings, whose areas are filled."""
    is_dashed: bool = False
    is_arrow: bool = False
    """Whether only a small arrow along the middle of each line is drawn."""


def road_layers(road_map: RoadMap) -> Iterator[RoadLayer]:
    """Drivable areas, lanes, crosswalks, marked lines and driving directions."""
    areas = [one.boundary for one in road_map.drivable_areas]
    yield RoadLayer(color_name="road", lines=areas)
    lanes = road_map.lanes
    inside = [one.outline_m() for one in lanes if one.is_intersection]
    yield RoadLayer(color_name="intersection", lines=inside)
    for name, kind in (
        ("lane", LaneKind.VEHICLE),
        ("bus_lane", LaneKind.BUS),
        ("bike_lane", LaneKind.BIKE),
    ):
        alike = [
            n.outline_m() for n in lanes if n.kind is kind and not n.is_intersection
        ]
        yield RoadLayer(color_name=name, lines=alike)
    stripes = [np.array(one.exterior.coords) for one in crosswalk_stripes(road_map)]
    yield RoadLayer(color_name="crosswalk", lines=stripes)
    for one in marked_lines(road_map, math.inf):
        yield RoadLayer(
            color_name=one.color_name,
            lines=one.lines.apart(),
            width_m=one.width_m,
            is_dashed=one.is_dashed,
        )
    centres = [one.centerline_m for one in lanes]
    yield RoadLayer(color_name="direction", lines=centres, is_arrow=True)
