"""The road as flat meshes: surface, lanes, lane markings, crosswalks, centre lines.

Meshes are made once per original map, finely enough to follow any warp; a warp then
moves their vertices.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry
from shapely.validation import make_valid

from pd_editor.scene.geometry.angles import left_of
from pd_editor.scene.geometry.lines import Lines, numbered
from pd_editor.scene.geometry.polyline import densify
from pd_editor.scene.road_layers import (
    DASH_M,
    EDGE_WIDTH_M,
    GAP_M,
    crosswalk_stripes,
    marked_lines,
)
from pd_editor.scene.road_map import Lane, LaneKind, RoadMap
from pd_editor.viewer.meshes.flat_mesh import (
    FlatMesh,
    merged,
    ribbons,
    strips,
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
ARROW_EVERY_M: Final = 40.0
CELL_M: Final = 8.0
"""Areas are cut into cells of this size, so that they bend with a warp."""


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
        layer: Layer, color_name: str, height_m: float, *meshes: FlatMesh
    ) -> RoadPart:
        return RoadPart(
            layer=layer, color_name=color_name, height_m=height_m, mesh=merged(meshes)
        )

    def lanes(*kinds: LaneKind, is_inside: bool = False) -> FlatMesh:
        return _lane_surfaces(
            [
                lane
                for lane in road_map.lanes
                if lane.kind in kinds and lane.is_intersection is is_inside
            ]
        )

    markings = _markings(road_map)
    stripes = triangulated(list(crosswalk_stripes(road_map)))
    return (
        part("road", "road", 0.0, cells(_areas(road_map))),
        # Connectors cover a junction from all sides; tinted, they would fill all of it.
        part("lanes", "intersection", 0.01, lanes(*LaneKind, is_inside=True)),
        part("lanes", "lane", 0.012, lanes(LaneKind.VEHICLE)),
        part("lanes", "bus_lane", 0.014, lanes(LaneKind.BUS)),
        part("lanes", "bike_lane", 0.016, lanes(LaneKind.BIKE)),
        part("lanes", "lane_edge", 0.02, *markings["lane_edge"]),
        part("crosswalks", "crosswalk", 0.03, stripes),
        part("markings", "white_marking", 0.04, *markings["white_marking"]),
        part("markings", "yellow_marking", 0.045, *markings["yellow_marking"]),
        part("markings", "direction", 0.047, _direction_arrows(road_map)),
        part("centerlines", "centerline", 0.05, _centerlines(road_map)),
    )


def _lane_surfaces(lanes: Sequence[Lane]) -> FlatMesh:
    sides = [*(lane.left_m for lane in lanes), *(lane.right_m for lane in lanes)]
    lines = Lines.of(sides).without_repeats()
    length = lines.length_m
    longest = length.reshape(2, -1).max(axis=0)
    count = np.maximum(np.ceil(longest / SPACING_M).astype(int) + 1, 2)
    spacing = length / (np.tile(count, 2) - 1)
    line, index = numbered(np.tile(count, 2))
    left, right = np.split(lines.at(line, index * spacing[line]), 2)
    return strips(Lines(points_m=left, count=count), right)


def _areas(road_map: RoadMap) -> Iterator[BaseGeometry]:
    for area in road_map.drivable_areas:
        if len(area.boundary) >= 4:
            ring = np.concatenate([area.boundary, area.boundary[:1]])[:, :2]
            yield make_valid(shapely.Polygon(densify(ring, SPACING_M)))


def cells(areas: Iterable[BaseGeometry]) -> FlatMesh:
    """Areas cut into square cells and triangulated."""
    whole, cut = [np.zeros((0, 2))], []
    for area in areas:
        if area.is_empty:
            continue
        shapely.prepare(area)
        low_x, low_y, high_x, high_y = np.array(area.bounds) / CELL_M
        x, y = np.meshgrid(
            np.arange(np.floor(low_x), np.ceil(high_x)),
            np.arange(np.floor(low_y), np.ceil(high_y)),
        )
        corner = np.stack([x.ravel(), y.ravel()], axis=-1) * CELL_M
        square = shapely.box(*corner.T, *(corner + CELL_M).T)
        is_inside = shapely.contains_properly(area, square)
        whole.append(corner[is_inside])
        on_edge = ~is_inside & shapely.intersects(area, square)
        cut.extend(shapely.get_parts(shapely.intersection(area, square[on_edge])))
    pieces = np.array(cut, object)
    is_area = shapely.get_type_id(pieces) == shapely.GeometryType.POLYGON
    is_area &= shapely.area(pieces) > 1e-4
    return merged(
        [_square_cells(np.concatenate(whole)), triangulated(pieces[is_area].tolist())]
    )


def _square_cells(corner_m: Float[np.ndarray, "N 2"]) -> FlatMesh:
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * CELL_M
    points = (corner_m[:, None, :] + steps).reshape(-1, 2)
    first = 4 * np.arange(len(corner_m))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return FlatMesh(points_m=points, faces=faces)


def _markings(road_map: RoadMap) -> dict[str, list[FlatMesh]]:
    """Meshes of the boundaries of lanes by colour."""
    meshes: dict[str, list[FlatMesh]] = {
        name: [] for name in ("lane_edge", "white_marking", "yellow_marking")
    }
    for one in marked_lines(road_map, SPACING_M):
        drawn = _dashes(one.lines) if one.is_dashed else one.lines
        meshes[one.color_name].append(ribbons(drawn, one.width_m))
    return meshes


def _dashes(lines: Lines) -> Lines:
    period, length = DASH_M + GAP_M, lines.length_m
    number = np.maximum(np.ceil(length / period - 0.5).astype(int), 0)
    line, index = numbered(number)
    start = GAP_M / 2 + period * index
    end = np.minimum(start + DASH_M, length[line])
    points = lines.at(line.repeat(3), np.linspace(start, end, 3, axis=-1).ravel())
    return Lines(points_m=points, count=np.full(len(line), 3))


def _centerlines(road_map: RoadMap) -> FlatMesh:
    lines = Lines.of([lane.centerline_m for lane in road_map.lanes]).without_repeats()
    return ribbons(lines.densified(SPACING_M), EDGE_WIDTH_M)


def _direction_arrows(road_map: RoadMap) -> FlatMesh:
    """Heads of arrows along lanes outside junctions, where those would hide each other."""
    lanes = [lane.centerline_m for lane in road_map.lanes if not lane.is_intersection]
    lines = Lines.of(lanes).without_repeats()
    count = np.round(lines.length_m / ARROW_EVERY_M + 0.4).astype(int)
    line, index = numbered(count)
    at = lines.length_m[line] * (index + 0.5) / count[line]
    tip, next_to_it = lines.at(line, at), lines.at(line, at + 1e-3)
    step = next_to_it - tip
    ahead = step / np.maximum(np.linalg.norm(step, axis=-1, keepdims=True), 1e-9)
    back, side = tip - 0.6 * ahead, 0.5 * left_of(ahead)
    corners = np.stack(
        [tip + 1.2 * ahead, back + side, tip - 0.2 * ahead, back - side], 1
    )
    first = 4 * np.arange(len(line))[:, None, None]
    return FlatMesh(
        points_m=corners.reshape(-1, 2),
        faces=(first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3),
    )
