"""Footways of pedestrians on maps without sidewalks: along kerbs and over crosswalks."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.scene.geometry.angles import heading_of, unit_vector
from pd_editor.scene.geometry.polyline import arc_length, resample
from pd_editor.scene.road_map import Crosswalk, RoadMap

OUTSIDE_M: Final = 1.7
"""Distance of a footway's centre line from the edge of the drivable area or of a lane."""
RIM_M: Final = 6.0
"""Length by which roads extend beyond the ends of a map's lanes."""
SMOOTH_M: Final = 1.5
"""Smaller details of an edge are smoothed."""
MIN_LENGTH_M: Final = 15.0
REACH_M: Final = 6.0
"""Largest distance from the end of a crosswalk to its footway."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """Crosswalk between two points on footways."""

    line_m: Float[np.ndarray, "N 2"]
    """Centre line from one footway to the other."""
    footway: tuple[int, int]
    """Indices of the footways at its two ends."""
    along_m: tuple[float, float]
    """Arc lengths of its ends on these footways."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Footways:
    """Lines that pedestrians use in both directions, and crossings between them."""

    lines_m: tuple[Float[np.ndarray, "_ 2"], ...]
    crossings: tuple[Crossing, ...]

    @property
    def length_m(self) -> float:
        """Total length of all lines."""
        return float(sum(arc_length(line)[-1] for line in self.lines_m))


def footways_of(road_map: RoadMap) -> Footways:
    """Footways outside the drivable area; none on a map without lanes."""
    if not road_map.lanes:
        return Footways(lines_m=(), crossings=())
    rings = [area.boundary[:, :2] for area in road_map.drivable_areas]
    rings += [lane.outline_m() for lane in road_map.lanes]
    paved = shapely.union_all([shapely.Polygon(ring).buffer(0.0) for ring in rings])
    # Closing fills the gaps between the polygons of a road; opening removes spikes.
    rounded = paved.buffer(OUTSIDE_M + SMOOTH_M).buffer(-SMOOTH_M)
    edge = rounded.boundary.difference(shapely.union_all(_rims(road_map)))
    lines = tuple(
        shapely.get_coordinates(part.simplify(0.05))
        for part in _line_strings(edge)
        if part.length >= MIN_LENGTH_M
    )
    ways = [shapely.LineString(line) for line in lines]
    found = (_crossing(one, ways) for one in road_map.crosswalks)
    return Footways(
        lines_m=lines, crossings=tuple(one for one in found if one is not None)
    )


def _rims(road_map: RoadMap) -> list[shapely.Geometry]:
    """Areas in which roads continue beyond the map."""
    known = road_map.lane_of
    starts, ways = [], []
    for lane in road_map.lanes:
        line = lane.centerline_m
        if not any(after in known for after in lane.successors):
            starts.append(line[-1])
            ways.append(line[-1] - line[-2])
        if not any(before in known for before in lane.predecessors):
            starts.append(line[0])
            ways.append(line[0] - line[1])
    if not starts:
        return []
    beyond = np.stack(starts) + RIM_M * unit_vector(heading_of(np.stack(ways)))
    return [
        shapely.LineString([start, end]).buffer(4.0, cap_style="flat")
        for start, end in zip(starts, beyond, strict=True)
    ]


def _line_strings(shape: Any) -> Iterable[shapely.LineString]:
    merged = shapely.line_merge(shape)
    parts = shapely.get_parts(merged).tolist()
    return [part for part in parts if isinstance(part, shapely.LineString)]


def _crossing(crosswalk: Crosswalk, ways: list[shapely.LineString]) -> Crossing | None:
    """Centre line of a crosswalk, extended to the footways; None if one is missing."""
    outline = crosswalk.outline_m()
    count = len(crosswalk.edge1)
    one, other = outline[:count], outline[count:][::-1]
    if len(one) < 2 or len(other) < 2 or not ways:
        return None
    middle = (resample(one, 5) + resample(other, 5)) / 2
    found = []
    for end in (middle[0], middle[-1]):
        distance = shapely.distance(ways, shapely.Point(end))
        nearest = int(np.argmin(distance))
        if distance[nearest] > REACH_M:
            return None
        along = float(ways[nearest].project(shapely.Point(end)))
        found.append((nearest, along, ways[nearest].interpolate(along)))
    (first, start, begin), (last, stop, finish) = found
    line = np.concatenate(
        [shapely.get_coordinates(begin), middle, shapely.get_coordinates(finish)]
    )
    return Crossing(line_m=line, footway=(first, last), along_m=(start, stop))
