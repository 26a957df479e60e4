"""What is drawn of a road seen from above, from the ground up."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry
from shapely.validation import make_valid

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.road_map import Crosswalk, LaneKind, LaneMark, RoadMap

EDGE_WIDTH_M: Final = 0.08
DASH_M: Final = 3.0
GAP_M: Final = 6.0
"""Between dashes; lines begin with half of it."""
DOUBLE_LINE_OFFSET_M: Final = 0.17

STRIPE_M: Final = 0.5
"""Width of the stripes and of the gaps between them."""
MIN_STRIPE_AREA_M2: Final = 0.3
"""Smaller rests of a stripe, at the ends of a crossing, are left out."""
_PIECE_M: Final = 2.0
"""Stripes bend with a warp in pieces of this length."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkedLines:
    """Lines on the ground that look alike."""

    color_name: str
    """A field of ``palette.Palette``."""
    width_m: float
    is_dashed: bool
    lines: Lines


def marked_lines(road_map: RoadMap, spacing_m: float) -> Iterator[MarkedLines]:
    """Boundaries of lanes as drawn, with points at most ``spacing_m`` apart.

    Of unmarked ones those outside intersections.
    """
    found = boundaries(road_map)
    marks = np.array([mark for mark, *_ in found])
    is_inside = np.array([inside for _, inside, _ in found], bool)
    lines = Lines.of([line for *_, line in found]).without_repeats()
    dense = lines.densified(spacing_m)
    for mark in map(LaneMark, np.unique(marks)):
        is_unmarked = mark in (LaneMark.NONE, LaneMark.UNKNOWN)
        alike = (marks == mark) & (lines.count > 1) & ~(is_unmarked & is_inside)
        some = dense.taken(alike)
        if is_unmarked:
            yield MarkedLines(
                color_name="lane_edge",
                width_m=EDGE_WIDTH_M,
                is_dashed=False,
                lines=some,
            )
            continue
        styles = line_styles(mark)
        offset = DOUBLE_LINE_OFFSET_M * (len(styles) - 1)
        for style, side in zip(styles, (offset, -offset), strict=False):
            yield MarkedLines(
                color_name="yellow_marking" if "YELLOW" in mark else "white_marking",
                width_m=0.17,
                is_dashed=style == "dashed",
                lines=some.offset(side) if side else some,
            )


def boundaries(road_map: RoadMap) -> list[tuple[LaneMark, bool, np.ndarray]]:
    """Each boundary once, even if two lanes share it; marked versions take precedence."""
    found = [
        (mark, lane.is_intersection, line)
        for lane in road_map.lanes
        for mark, line in (
            (lane.left_mark, lane.left_m),
            (lane.right_mark, lane.right_m),
        )
    ]
    lines = Lines.of([line for *_, line in found])
    ends = np.round(2 * lines.points_m[lines.ends.T])
    lengths = np.round(lines.length_m)
    seen: dict[tuple, tuple[LaneMark, bool, np.ndarray]] = {}
    keys = zip(map(sorted, ends.tolist()), lengths.tolist(), strict=True)
    for one, ((start, end), length) in zip(found, keys, strict=True):
        key = (*start, *end, length)
        is_marked = one[0] not in (LaneMark.NONE, LaneMark.UNKNOWN)
        if key not in seen or (is_marked and seen[key][0] is LaneMark.NONE):
            seen[key] = one
    return list(seen.values())


def line_styles(mark: LaneMark) -> tuple[str, ...]:
    """Style of each marked line, from left to right."""
    if mark.startswith("DOUBLE_SOLID"):
        return ("solid", "solid")
    if mark.startswith("DOUBLE_DASH"):
        return ("dashed", "dashed")
    if mark.startswith("DASH_SOLID"):
        return ("dashed", "solid")
    if mark.startswith("SOLID_DASH"):
        return ("solid", "dashed")
    return ("dashed",) if mark.startswith("DASHED") else ("solid",)


def crosswalk_stripes(road_map: RoadMap) -> Iterator[shapely.Polygon]:
    """Parallel stripes of every crossing, on the drivable area only.

    Where two crossings overlap, the larger one has the ground, so that stripes of
    different directions never interleave.
    """
    areas = [_polygon(area.boundary[:, :2]) for area in road_map.drivable_areas]
    drivable = shapely.union_all(areas) if areas else None
    outlines = [_polygon(crossing.outline_m()) for crossing in road_map.crosswalks]
    taken: BaseGeometry = shapely.Polygon()
    for index in np.argsort([-outline.area for outline in outlines], kind="stable"):
        region = outlines[index]
        if drivable is not None:
            region = region & drivable
        free = region - taken
        taken = taken | region
        yield from _stripes(free, _direction(road_map.crosswalks[index]))


def _polygon(ring_m: Float[np.ndarray, "N 2"]) -> BaseGeometry:
    return make_valid(shapely.Polygon(ring_m)) if len(ring_m) >= 3 else shapely.Point()


def _direction(crossing: Crosswalk) -> Float[np.ndarray, "2"]:
    """Unit vector along the stripes: from one edge to the other, as traffic drives."""
    count = len(crossing.edge1)
    ring = crossing.outline_m()
    one, two = ring[:count], ring[count:][::-1]
    sides = np.stack([two[0] - one[0], two[-1] - one[-1]])
    sides /= np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-9)
    along = sides.sum(axis=0)
    return along / max(float(np.linalg.norm(along)), 1e-9)


def _stripes(
    region: BaseGeometry, along: Float[np.ndarray, "2"]
) -> Iterable[shapely.Polygon]:
    if region.is_empty or region.area < MIN_STRIPE_AREA_M2:
        return ()
    across = np.array([-along[1], along[0]])
    corners = shapely.get_coordinates(region)
    (low, high), (start, end) = (
        (float((corners @ axis).min()), float((corners @ axis).max()))
        for axis in (across, along)
    )
    count = max(round((high - low) / STRIPE_M - 1) // 2 + 1, 1)
    first = (low + high - (2 * count - 1) * STRIPE_M) / 2
    offset = first + 2 * STRIPE_M * np.arange(count)
    box = [(0.0, start), (STRIPE_M, start), (STRIPE_M, end), (0.0, end)]
    bands = np.stack(
        [(offset + v)[:, None] * across + u * along for v, u in box], axis=1
    )
    pieces = shapely.get_parts(shapely.intersection(shapely.polygons(bands), region))
    is_stripe = shapely.get_type_id(pieces) == shapely.GeometryType.POLYGON
    is_stripe &= shapely.area(pieces) >= MIN_STRIPE_AREA_M2
    return shapely.segmentize(pieces[is_stripe], _PIECE_M)


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
