"""The road as flat meshes: surface, lanes, lane markings, crosswalks, centre lines.

Meshes are made once per original map, finely enough to follow any warp; a warp then
moves their vertices.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry
from shapely.validation import make_valid

from pd_editor.geometry.polyline import (
    arc_length,
    densify,
    offset_line,
    point_at,
    resample,
    without_repeats,
)
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark, RoadMap
from pd_editor.viewer.meshes.crosswalk_stripes import crosswalk_stripes
from pd_editor.viewer.meshes.flat_mesh import (
    FlatMesh,
    merged,
    ribbon,
    strip,
    triangulated,
)

Layer = Literal["road", "lanes", "crosswalks", "markings", "centerlines"]
LAYERS: Final[tuple[Layer, ...]] = (
    "road",
    "lanes",
    "crosswalks",
    "markings",
    "centerlines",
)
SPACING_M: Final = 2.0
CELL_M: Final = 8.0
"""Areas are cut into cells of this size, so that they bend with a warp."""
MARKING_WIDTH_M: Final = 0.17
EDGE_WIDTH_M: Final = 0.08
DASH_M: Final = 3.0
GAP_M: Final = 6.0
DOUBLE_LINE_OFFSET_M: Final = 0.17


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadPart:
    """All triangles of one colour in one layer."""

    layer: Layer
    color_name: str
    """A field of ``palette.Palette``."""
    height_m: float
    mesh: FlatMesh


def road_parts(road_map: RoadMap) -> tuple[RoadPart, ...]:
    """Every coloured part of a map, from the ground up."""

    def part(
        layer: Layer, color_name: str, height_m: float, meshes: Iterable[FlatMesh]
    ) -> RoadPart:
        return RoadPart(
            layer=layer,
            color_name=color_name,
            height_m=height_m,
            mesh=merged(list(meshes)),
        )

    def lanes_where(*kinds: LaneKind, is_inside: bool = False) -> Iterator[FlatMesh]:
        for lane in road_map.lanes:
            if lane.kind in kinds and lane.is_intersection is is_inside:
                yield _lane_surface(lane)

    markings = list(_marked_lines(road_map))
    return (
        part("road", "road", 0.0, _area_meshes(road_map)),
        # Connectors cover a junction from all sides; tinted, they would fill all of it.
        part("lanes", "intersection", 0.01, lanes_where(*LaneKind, is_inside=True)),
        part("lanes", "lane", 0.012, lanes_where(LaneKind.VEHICLE)),
        part("lanes", "bus_lane", 0.014, lanes_where(LaneKind.BUS)),
        part("lanes", "bike_lane", 0.016, lanes_where(LaneKind.BIKE)),
        part("lanes", "lane_edge", 0.02, (m for c, m in markings if c == "lane_edge")),
        part("crosswalks", "crosswalk", 0.03, crosswalk_stripes(road_map)),
        part(
            "markings",
            "white_marking",
            0.04,
            (m for c, m in markings if c == "white_marking"),
        ),
        part(
            "markings",
            "yellow_marking",
            0.045,
            (m for c, m in markings if c == "yellow_marking"),
        ),
        part("centerlines", "centerline", 0.05, _centerline_arrows(road_map)),
    )


def _lane_surface(lane: Lane) -> FlatMesh:
    left, right = without_repeats(lane.left_m), without_repeats(lane.right_m)
    longest = max(arc_length(left)[-1], arc_length(right)[-1])
    count = max(int(np.ceil(longest / SPACING_M)) + 1, 2)
    return strip(resample(left, count), resample(right, count))


def _area_meshes(road_map: RoadMap) -> Iterator[FlatMesh]:
    for area in road_map.drivable_areas:
        if len(area.boundary) >= 4:
            ring = densify(
                area.boundary[[*range(len(area.boundary)), 0], :2], SPACING_M
            )
            polygon = make_valid(shapely.Polygon(ring))
            yield from cell_meshes(polygon)


def cell_meshes(area: BaseGeometry) -> Iterator[FlatMesh]:
    """An area cut into square cells and triangulated."""
    if area.is_empty:
        return
    shapely.prepare(area)
    low_x, low_y, high_x, high_y = np.array(area.bounds) / CELL_M
    x, y = np.meshgrid(
        np.arange(np.floor(low_x), np.ceil(high_x)),
        np.arange(np.floor(low_y), np.ceil(high_y)),
    )
    corner = np.stack([x.ravel(), y.ravel()], axis=-1) * CELL_M
    cells = shapely.box(
        corner[:, 0], corner[:, 1], corner[:, 0] + CELL_M, corner[:, 1] + CELL_M
    )
    is_inside = shapely.contains_properly(area, cells)
    yield _square_cells(corner[is_inside])
    on_edge = ~is_inside & shapely.intersects(area, cells)
    pieces = shapely.get_parts(shapely.intersection(area, cells[on_edge]))
    for piece in pieces:
        if piece.geom_type == "Polygon" and piece.area > 1e-4:
            yield triangulated(piece)


def _square_cells(corner_m: Float[np.ndarray, "N 2"]) -> FlatMesh:
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * CELL_M
    points = (corner_m[:, None, :] + steps).reshape(-1, 2)
    first = 4 * np.arange(len(corner_m))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return FlatMesh(points_m=points, faces=faces)


def _boundaries(road_map: RoadMap) -> Iterator[tuple[LaneMark, bool, np.ndarray]]:
    """Each boundary once, even if two lanes share it; marked versions take precedence."""
    seen: dict[tuple, tuple[LaneMark, bool, np.ndarray]] = {}
    for lane in road_map.lanes:
        for mark, line in (
            (lane.left_mark, lane.left_m),
            (lane.right_mark, lane.right_m),
        ):
            ends = sorted(map(tuple, np.round(line[[0, -1]] * 2).astype(int).tolist()))
            key = (*ends, round(float(arc_length(line)[-1])))
            is_marked = mark not in (LaneMark.NONE, LaneMark.UNKNOWN)
            if key not in seen or (is_marked and seen[key][0] is LaneMark.NONE):
                seen[key] = (mark, lane.is_intersection, line)
    yield from seen.values()


def _marked_lines(road_map: RoadMap) -> Iterator[tuple[str, FlatMesh]]:
    for mark, is_intersection, boundary in _boundaries(road_map):
        line = without_repeats(boundary)
        if len(line) < 2:
            continue
        dense = densify(line, SPACING_M)
        if mark in (LaneMark.NONE, LaneMark.UNKNOWN):
            if not is_intersection:
                yield "lane_edge", ribbon(dense, EDGE_WIDTH_M)
            continue
        color = "yellow_marking" if "YELLOW" in mark else "white_marking"
        styles = _line_styles(mark)
        offsets = (
            (0.0,)
            if len(styles) == 1
            else (DOUBLE_LINE_OFFSET_M, -DOUBLE_LINE_OFFSET_M)
        )
        for style, offset in zip(styles, offsets, strict=True):
            shifted = offset_line(dense, offset) if offset else dense
            if style == "solid":
                yield color, ribbon(shifted, MARKING_WIDTH_M)
            else:
                yield from ((color, dash) for dash in _dashes(shifted))


def _line_styles(mark: LaneMark) -> tuple[str, ...]:
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


def _dashes(line_m: np.ndarray) -> Iterator[FlatMesh]:
    length = arc_length(line_m)[-1]
    for start in np.arange(GAP_M / 2, length - DASH_M / 2, DASH_M + GAP_M):
        end = min(start + DASH_M, length)
        yield ribbon(point_at(line_m, np.linspace(start, end, 3)), MARKING_WIDTH_M)


def _centerline_arrows(road_map: RoadMap) -> Iterator[FlatMesh]:
    for lane in road_map.lanes:
        line = without_repeats(lane.centerline_m)
        if len(line) < 2:
            continue
        yield ribbon(densify(line, SPACING_M), EDGE_WIDTH_M)
        tip = point_at(line, np.array([0.5, 0.5 + 1e-3]) * arc_length(line)[-1])
        ahead = (tip[1] - tip[0]) / max(float(np.linalg.norm(tip[1] - tip[0])), 1e-9)
        side = np.array([-ahead[1], ahead[0]])
        arrow = np.array(
            [
                tip[0] + ahead,
                tip[0] - 0.4 * ahead + 0.45 * side,
                tip[0] - 0.4 * ahead - 0.45 * side,
            ]
        )
        yield FlatMesh(points_m=arrow, faces=np.array([[0, 1, 2]]))
