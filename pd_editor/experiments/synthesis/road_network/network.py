"""Road networks for SUMO with their Argoverse 2 map, and how they are built street by street."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float
from shapely import LineString

from pd_editor.experiments.synthesis.road_network.footways import Footways
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainConnection,
    PlainEdge,
    PlainNetwork,
    PlainNode,
    Strip,
    StripKind,
)
from pd_editor.experiments.synthesis.road_network.streets import (
    SPACING_M,
    Carriageway,
    CurveKind,
    curve,
)
from pd_editor.experiments.synthesis.sumo.parking_bays import ParkingBay
from pd_editor.scene.geometry.polyline import arc_length, densify, offset_line, point_at
from pd_editor.scene.road_map import RoadMap


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """Road network in the frame of the SUMO net, in metres."""

    name: str
    family: str
    folder: Path
    """Folder of ``net_file`` and of the files that it was made from."""
    net_file: Path
    road_map: RoadMap
    lane_of_sumo: Mapping[str, tuple[int, ...]]
    """Lanes of the map along each SUMO lane, in driving order.

    Includes junction lanes but no sidewalks and parking strips. Several SUMO lanes may
    map to the same lane.
    """
    has_signals: bool
    parking_strips_m: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    """Centre lines of the parking strips along the kerb, in driving direction."""
    parking_bays: tuple[ParkingBay, ...] = ()
    footways: Footways | None = None
    """Footways, if SUMO's net has no sidewalks."""


PlaneWarp = Callable[[Float[np.ndarray, "N 2"]], Float[np.ndarray, "N 2"]]
TAPER_M: Final = 22.0
"""Length over which an additional lane opens or closes."""
_JUNCTION_M: Final = 14.0
"""Approximate length of street ends that a junction occupies."""
_CLEAR_M: Final = 15.0
"""Least distance between centre lines of streets away from their junctions."""
_NEAR_JUNCTION_M: Final = 23.0


@dataclass(kw_only=True)
class NetworkBuilder:
    """Nodes and edges of a network under construction.

    All points are warped by ``warp`` when they are added.
    """

    nodes: dict[str, PlainNode] = field(default_factory=dict)
    put_m: dict[str, Float[np.ndarray, "2"]] = field(default_factory=dict)
    """Positions of nodes before the warp."""
    edges: list[PlainEdge] = field(default_factory=list)
    connections: list[PlainConnection] = field(default_factory=list)
    removed: list[tuple[str, str]] = field(default_factory=list)
    """Pairs of edges without a connection."""
    roundabouts: list[tuple[tuple[str, ...], tuple[str, ...]]] = field(
        default_factory=list
    )
    lines: list[LineString] = field(default_factory=list)
    """Centre lines of the streets so far, before the warp."""
    warp: PlaneWarp = lambda points_m: points_m
    """Smooth warp of the plane, applied to all points."""

    def node(
        self,
        node_id: str,
        point_m: Float[np.ndarray, "2"],
        kind: NodeKind = NodeKind.PRIORITY,
        radius_m: float = 7.0,
    ) -> None:
        """Add a node."""
        self.put_m[node_id] = point_m
        self.warped_node(node_id, self.warp(point_m[None])[0], kind, radius_m)

    def warped_node(
        self,
        node_id: str,
        point_m: Float[np.ndarray, "2"],
        kind: NodeKind = NodeKind.PRIORITY,
        radius_m: float = 7.0,
    ) -> None:
        """Add a node at a warped position."""
        x, y = (float(value) for value in point_m)
        self.nodes[node_id] = PlainNode(
            node_id=node_id, point_m=(x, y), kind=kind, radius_m=radius_m
        )

    def point_m(self, node_id: str) -> Float[np.ndarray, "2"]:
        """Position of a node before the warp."""
        return self.put_m[node_id]

    def line_m(
        self,
        start: str,
        end: str,
        kind: CurveKind = CurveKind.STRAIGHT,
        turn_rad: float = 0.0,
    ) -> Float[np.ndarray, "N 2"]:
        """Curve between two nodes."""
        return curve(self.point_m(start), self.point_m(end), kind, turn_rad)

    def one_way(
        self,
        start: str,
        end: str,
        left_edge_m: Float[np.ndarray, "N 2"],
        strips: tuple[Strip, ...],
        speed_mps: float,
        priority: int = 1,
    ) -> str:
        """Add one direction of a street, given its left edge; returns the edge's id."""
        edge_id = f"{start}-{end}"
        self.edges.append(
            PlainEdge(
                edge_id=edge_id,
                start=start,
                end=end,
                left_edge_m=left_edge_m,
                strips=strips,
                speed_mps=speed_mps,
                priority=priority,
            )
        )
        return edge_id

    def street(
        self,
        start: str,
        end: str,
        middle_m: Float[np.ndarray, "N 2"],
        carriageway: Carriageway,
        *,
        bay_m: float = 0.0,
        bays: tuple[bool, bool] = (True, True),
    ) -> None:
        """Add a street along its centre line: both directions, or one if it is one-way.

        Left-turn lanes of length ``bay_m`` open in the median before the chosen ends.
        """
        self.lines.append(LineString(middle_m))
        middle_m = self.warp(densify(middle_m, SPACING_M))
        if carriageway.is_one_way:
            left = offset_line(middle_m, carriageway.width_m() / 2)
            self.one_way(
                start,
                end,
                left,
                carriageway.strips(),
                carriageway.speed_mps,
                carriageway.num_lanes,
            )
            return
        has_room = carriageway.median_m >= carriageway.lane_width_m
        for first, last, line, has_bay in (
            (start, end, middle_m, bays[1]),
            (end, start, middle_m[::-1], bays[0]),
        ):
            left = offset_line(line, -carriageway.median_m / 2)
            self._direction(
                first, last, left, carriageway, bay_m if has_room and has_bay else 0.0
            )

    def _direction(
        self,
        start: str,
        end: str,
        left_m: Float[np.ndarray, "N 2"],
        carriageway: Carriageway,
        bay_m: float,
    ) -> None:
        strips, speed = carriageway.strips(), carriageway.speed_mps
        priority = carriageway.num_lanes
        length = float(arc_length(left_m)[-1])
        room_m = length / 2 - _JUNCTION_M - TAPER_M
        bay_m = min(bay_m, room_m)
        opens_m = length - _JUNCTION_M - bay_m - TAPER_M
        if bay_m < 12.0:
            self.one_way(start, end, left_m, strips, speed, priority)
            return
        before, taper, after = split(left_m, [opens_m, opens_m + TAPER_M])
        fork = f"{start}-{end}.bay"
        self.warped_node(fork, taper[len(taper) // 2])
        lane = Strip(kind=StripKind.CAR, width_m=carriageway.lane_width_m)
        first = self.one_way(start, fork, before, strips, speed, priority)
        after = offset_line(after, lane.width_m)
        last = self.one_way(fork, end, after, (*strips, lane), speed, priority)
        pairs = [(k, k) for k in range(len(strips))]
        self.connect(first, last, strips, [*pairs, (len(strips) - 1, len(strips))])

    def connect(
        self,
        start: str,
        end: str,
        strips: tuple[Strip, ...],
        pairs: list[tuple[int, int]],
    ) -> None:
        """Connect pairs of strips of two edges; ``strips`` are those of the first edge."""
        self.connections += [
            PlainConnection(start=start, end=end, start_strip=a, end_strip=b)
            for a, b in pairs
            if strips[a].kind not in (StripKind.SIDEWALK, StripKind.PARKING)
        ]

    def is_free(
        self, middle_m: Float[np.ndarray, "N 2"], *, meets_at_end: bool = False
    ) -> bool:
        """Whether a street from a junction stays clear of all other streets."""
        length = float(arc_length(middle_m)[-1])
        end_m = length - _NEAR_JUNCTION_M if meets_at_end else length
        if end_m <= _NEAR_JUNCTION_M:
            return False
        part = point_at(middle_m, np.linspace(_NEAR_JUNCTION_M, end_m, 12))
        distances = shapely.distance(np.array(self.lines, object), LineString(part))
        return bool(np.all(distances > _CLEAR_M))

    def network(self, crossing_width_m: float) -> PlainNetwork:
        """The network for netconvert."""
        return PlainNetwork(
            nodes=tuple(self.nodes.values()),
            edges=tuple(self.edges),
            connections=tuple(self.connections),
            removed=tuple(self.removed),
            crossing_width_m=crossing_width_m,
            roundabouts=tuple(self.roundabouts),
        )


def split(
    line_m: Float[np.ndarray, "N 2"], at_m: list[float]
) -> list[Float[np.ndarray, "_ 2"]]:
    """Split a line at distances along it."""
    along = arc_length(line_m)
    bounds = [0.0, *at_m, float(along[-1])]
    result = []
    for start, end in itertools.pairwise(bounds):
        inner = line_m[(along > start + 0.1) & (along < end - 0.1)]
        ends = point_at(line_m, np.array([start, end]))
        result.append(np.concatenate([ends[:1], inner, ends[1:]]))
    return result
